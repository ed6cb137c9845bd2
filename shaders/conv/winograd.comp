// Winograd's transforms of images and maps, for convolutions 4x4 of stride 2 and padding 1: B f of
// the finer image, A c of the coarser one, and their transposes B^T and A^T (conv/winograd.glsl has
// the algebra, the shapes and the source). A row of the finer image's matrices is a channel and a
// phase, 4 channel + 2 py + px. An invocation makes two tiles side by side.
// maps = A^T [(G weight) (B image)], summed over channels: matrices [kPoints^2, rows, tiles].
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/panels.h"
#include "conv/params.h"
#include "conv/winograd.glsl"
PARAMS(WinogradParams, 5)
QUADS(0, image);                        // [images, channels, height, width]
BUFFER(1, readwrite, Pair, matrices);   // [kPoints^2, rows, tiles] as kLayout says, in pairs
BUFFER(2, writeonly, Pair, result);     // as image
BUFFER(3, readonly, float, bias);       // [channels]
BUFFER(4, writeonly, float, single);    // the matrices, one by one

// How the matrices lie: row by row, or in panels (common/panels.h) of kWidth rows or tiles.
layout(constant_id = 2) const uint kLayout = 0;
layout(constant_id = 3) const uint kWidth = 32;  // a power of two
layout(constant_id = 4) const bool kBias = false;

// Channels count from this dispatch's first. Workgroups: x pairs of tiles side by side, y channels;
// or, in panels of rows, the other way round, so that neighbours write side by side. Of the finer
// image y is there twice, for py = 0 and 1. z images.
struct Work {
    uint pair, channel, py;
    bool any;
};
Work workOf(bool fine) {
    uint x = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint y = fine ? gl_WorkGroupID.y / 2 : gl_WorkGroupID.y, py = gl_WorkGroupID.y % 2;
    if (kLayout == kLayoutRowPanels) return Work(y, x, py, x < params.partChannels);
    return Work(x, y, py, x < params.tiles / 2);
}
// Tile row and pair within it.
uvec2 tilePair(uint pair) {
    uint at = params.firstTile / 2 + pair, row = quotient(at, params.byRow);
    return uvec2(remainder(at, row, params.byRow), row);
}
uint plane(uint channel) {
    return params.startImage +
           (gl_WorkGroupID.z * params.channels + params.firstChannel + channel) * params.height *
               params.width;
}

// Of a matrix: the element of a row and a tile of the piece.
uint place(uint matrix, uint row, uint tile, uint rows) {
    uint tiles = kLayout == kLayoutRowPanels ? params.panelSteps : params.images * params.tiles;
    return matrix * params.strideMatrix + elementIndex(kLayout, kWidth, row, tile, rows, tiles);
}

// Four pixels from x on, a multiple of four; zeros outside, where positions wrap to large ones.
vec4 fourPixels(uint start, uint y, uint x) {
    bool inside = y < params.height && x < params.width;
    uint at = start + (inside ? y * params.width + x : 0);
    vec4 v = quadAt(image, at / 4);
    return inside ? v : vec4(0);
}

// B f: per tile of (2 kResults + 2)^2 pixels and phase.
ENTRY(fine_to_tiles) {
    Work work = workOf(true);
    if (!work.any) return;
    uint pair = work.pair, channel = work.channel, py = work.py;
    uvec2 at = tilePair(pair);
    uint start = plane(channel), tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    float across[2][2][5][kMostSeen];  // tile, px, point, row of the phase
    [[unroll]] for (uint r = 0; r < kSeen; ++r) {
        // The pair's pixels, and four more at both ends, of which one is wanted.
        uint y = 2 * (kResults * at.y + r) + py - 1, x = 4 * kResults * at.x - 4;
        float v[24];
        [[unroll]] for (uint i = 0; i < kResults + 2; ++i) {
            vec4 four = fourPixels(start, y, x + 4 * i);
            [[unroll]] for (uint k = 0; k < 4; ++k) v[4 * i + k] = four[k];
        }
        [[unroll]] for (uint t = 0; t < 2; ++t)
            [[unroll]] for (uint px = 0; px < 2; ++px) {
                float f[kMostSeen], m[kMostPoints];
                [[unroll]] for (uint i = 0; i < kSeen; ++i)
                    f[i] = v[3 + 2 * (kResults * t + i) + px];
                toPoints(f, m);
                [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) across[t][px][mx][r] = m[mx];
            }
    }
    uint row = 4 * channel + 2 * py, rows = 4 * params.partChannels;
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float m[2][2][kMostPoints];  // tile, px, point
        [[unroll]] for (uint t = 0; t < 2; ++t)
            [[unroll]] for (uint px = 0; px < 2; ++px) toPoints(across[t][px][mx], m[t][px]);
        [[unroll]] for (uint my = 0; my < kPoints; ++my)
            [[unroll]] for (uint i = 0; i < 2; ++i) {
                uint matrix = kPoints * my + mx;
                if (kLayout == kLayoutRowPanels)
                    matrices.d[place(matrix, row, tile + i, rows) / 2] =
                        packPair(vec2(m[i][0][my], m[i][1][my]));
                else
                    matrices.d[place(matrix, row + i, tile, rows) / 2] =
                        packPair(vec2(m[0][i][my], m[1][i][my]));
            }
    }
}

// A c: per tile of kResults^2 pixels.
ENTRY(coarse_to_tiles) {
    Work work = workOf(false);
    if (!work.any) return;
    uint pair = work.pair, channel = work.channel;
    uvec2 at = tilePair(pair);
    uint tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    float across[2][5][4];  // tile, point, row
    [[unroll]] for (uint r = 0; r < kResults; ++r) {
        float v[8];
        [[unroll]] for (uint i = 0; i < kResults / 2; ++i) {
            vec4 four =
                fourPixels(plane(channel), kResults * at.y + r, 2 * kResults * at.x + 4 * i);
            [[unroll]] for (uint k = 0; k < 4; ++k) v[4 * i + k] = four[k];
        }
        [[unroll]] for (uint t = 0; t < 2; ++t) {
            float c[4], m[kMostPoints];
            [[unroll]] for (uint i = 0; i < kResults; ++i) c[i] = v[kResults * t + i];
            toProducts(c, m);
            [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) across[t][mx][r] = m[mx];
        }
    }
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float m[2][kMostPoints];
        [[unroll]] for (uint t = 0; t < 2; ++t) toProducts(across[t][mx], m[t]);
        [[unroll]] for (uint my = 0; my < kPoints; ++my) {
            uint matrix = kPoints * my + mx;
            if (kLayout == kLayoutRowPanels) {
                [[unroll]] for (uint t = 0; t < 2; ++t)
                    single.d[place(matrix, channel, tile + t, params.partChannels)] = m[t][my];
            } else {
                matrices.d[place(matrix, channel, tile, params.partChannels) / 2] =
                    packPair(vec2(m[0][my], m[1][my]));
            }
        }
    }
}

// A^T of the products (+ bias).
ENTRY(coarse_from_tiles) {
    Work work = workOf(false);
    if (!work.any) return;
    uint pair = work.pair, channel = work.channel;
    uvec2 at = tilePair(pair);
    uint tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    float down[2][4][kMostPoints];  // tile, row, point
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float m[2][kMostPoints];
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

// Row my of a pair of tiles in tile row y, one phase: what pixels get that are two apart. For px =
// 1 they are the pair's first, third, …, and the tile to the left reaches into the first; for px =
// 0 the second, fourth, …, and the tile to the right into the last.
void along(uint row, uint my, uint px, uint x, uint y, out float u[8]) {
    uint pairs = params.byRow.divisor, tilesDown = params.height / (2 * kResults);
    bool inside = y < tilesDown;  // above the first row, positions wrap to large ones
    uint first = gl_WorkGroupID.z * params.tiles + 2 * ((inside ? y : 0) * pairs + x);
    uint rows = 4 * params.partChannels;
    float m[2][kMostPoints], own[2][kMostSeen];
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
        float down[8][kMostPoints];
        [[unroll]] for (uint my = 0; my < kPoints; ++my) {
            float u[8];
            along(row, my, px, at.x, at.y, u);
            [[unroll]] for (uint i = 0; i < 2 * kResults; ++i) down[i][my] = u[i];
        }
        float beside[8];  // of the tiles above, or below
        along(row, py == 1 ? kPoints - 1 : 0, px, at.x, py == 1 ? at.y - 1 : at.y + 1, beside);
        [[unroll]] for (uint i = 0; i < 2 * kResults; ++i) {
            float u[kMostSeen];
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
