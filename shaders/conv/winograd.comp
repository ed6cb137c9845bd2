// Winograd's transforms of images and maps, for convolutions 4x4 of stride 2 and padding 1: B f of
// the finer image, A c of the coarser one, and their transposes B^T and A^T (conv/winograd.glsl has
// the algebra, the shapes and the source). A row of the finer image's matrices is a channel and a
// phase, 4 channel + 2 py + px. An invocation makes two tiles side by side.
// maps = A^T [(G weight) (B image)], summed over channels: matrices [kPoints^2, rows, tiles].
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "conv/params.h"
#include "conv/winograd.glsl"
#define TEXEL_LOADS 0
#include "conv/winograd_tiles.glsl"

ENTRY(fine_to_tiles) { fineToTiles(); }
ENTRY(coarse_to_tiles) { coarseToTiles(); }

// A^T of the products (+ bias).
ENTRY(coarse_from_tiles) {
    Work work = workOf(false);
    if (!work.any) return;
    uint pair = work.pair, channel = work.channel;
    uvec2 at = tilePair(pair);
    uint tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    float down[2][4][9];  // tile, row, point
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float m[2][9];
        [[unroll]] for (uint my = 0; my < kPoints; ++my) {
            uint from = place(kPoints * my + mx, channel, tile, params.partChannels);
            vec2 both = unpackPair(matrices.d[from / 2]);
            [[unroll]] for (uint t = 0; t < 2; ++t) m[t][my] = both[t];
        }
        [[unroll]] for (uint t = 0; t < 2; ++t) {
            float c[4];
            fromProducts(m[t], c);
            [[unroll]] for (uint r = 0; r < kResults; ++r) down[t][r][mx] = c[r];
        }
    }
    float b = kBias ? bias.d[params.firstChannel + channel] : 0;
    [[unroll]] for (uint r = 0; r < kResults; ++r) {
        uint pixel = plane(channel) + (kResults * at.y + r) * params.width + 2 * kResults * at.x;
        [[unroll]] for (uint t = 0; t < 2; ++t) {
            float c[4];
            fromProducts(down[t][r], c);
            [[unroll]] for (uint i = 0; i < kResults; i += 2)
                result.d[(pixel + kResults * t + i) / 2] = packPair(vec2(c[i], c[i + 1]) + b);
        }
    }
}

// What a tile reaches into the one before it, and behind it: B's first and last column have one
// number each.
float reachBefore(float firstProduct) { return kB[kSet][0][0] * firstProduct; }
float reachBehind(float lastProduct) { return kB[kSet][kPoints - 1][kSeen - 1] * lastProduct; }

// Row my of a pair of tiles in tile row y, one phase: what pixels get that are two apart. For px = 1
// they are the pair's first, third, …, and the tile to the left reaches into the first; for px = 0
// the second, fourth, …, and the tile to the right into the last.
void along(uint row, uint my, uint px, uint x, uint y, out float u[8]) {
    uint pairs = params.byRow.divisor, tilesDown = params.height / (2 * kResults);
    bool inside = y < tilesDown;  // above the first row, positions wrap to large ones
    uint first = gl_WorkGroupID.z * params.tiles + 2 * ((inside ? y : 0) * pairs + x);
    uint rows = 4 * params.partChannels;
    float m[2][9], own[2][7];
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        vec2 both = unpackPair(matrices.d[place(kPoints * my + mx, row, first, rows) / 2]);
        [[unroll]] for (uint t = 0; t < 2; ++t) m[t][mx] = both[t];
    }
    [[unroll]] for (uint t = 0; t < 2; ++t) {
        fromPoints(m[t], own[t]);
        [[unroll]] for (uint i = 0; i < kResults; ++i) u[kResults * t + i] = own[t][i + 1 - px];
    }
    if (px == 1) {
        uint matrix = kPoints * my + kPoints - 1;
        vec2 left = unpackPair(matrices.d[place(matrix, row, x > 0 ? first - 2 : first, rows) / 2]);
        u[0] += x > 0 ? reachBehind(left.y) : 0;
        u[kResults] += own[0][kResults];
    } else {
        bool last = x + 1 == pairs;
        vec2 right = unpackPair(
            matrices.d[place(kPoints * my, row, last ? first : first + 2, rows) / 2]);
        u[kResults - 1] += own[1][0];
        u[2 * kResults - 1] += last ? 0 : reachBefore(right.x);
    }
    if (!inside)
        [[unroll]] for (uint i = 0; i < 2 * kResults; ++i) u[i] = 0;
}

// B^T of the products (+ bias): the rows of one parity of the finer image under a pair of tiles, 4
// kResults pixels each, from the tiles over them. The piece is the whole image.
ENTRY(fine_from_tiles) {
    Work work = workOf(true);
    if (!work.any) return;
    uint pair = work.pair, channel = work.channel, py = work.py;
    uvec2 at = tilePair(pair);
    float b = kBias ? bias.d[params.firstChannel + channel] : 0;
    float pixels[2][4][8];  // px, row, two apart
    [[unroll]] for (uint px = 0; px < 2; ++px) {
        uint row = 4 * channel + 2 * py + px;
        float down[8][9];
        [[unroll]] for (uint my = 0; my < kPoints; ++my) {
            float u[8];
            along(row, my, px, at.x, at.y, u);
            [[unroll]] for (uint i = 0; i < 2 * kResults; ++i) down[i][my] = u[i];
        }
        float beside[8];  // of the tiles above, or below
        along(row, py == 1 ? kPoints - 1 : 0, px, at.x, py == 1 ? at.y - 1 : at.y + 1, beside);
        [[unroll]] for (uint i = 0; i < 2 * kResults; ++i) {
            float u[7];
            fromPoints(down[i], u);
            [[unroll]] for (uint r = 0; r < kResults; ++r)
                pixels[px][r][i] = (py == 1 ? u[r] : u[r + 1]) + b;
            if (py == 1)
                pixels[px][0][i] += reachBehind(beside[i]);
            else
                pixels[px][kResults - 1][i] += reachBefore(beside[i]);
        }
    }
    [[unroll]] for (uint r = 0; r < kResults; ++r) {
        uint y = 2 * (kResults * at.y + r) + 1 - py;
        uint pixel = plane(channel) + y * params.width + 4 * kResults * at.x;
        [[unroll]] for (uint i = 0; i < 2 * kResults; ++i)
            result.d[pixel / 2 + i] = packPair(vec2(pixels[1][r][i], pixels[0][r][i]));
    }
}
