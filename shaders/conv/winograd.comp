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

// A^T of the nine products (+ bias).
ENTRY(coarse_from_tiles) {
    uint pair = pairInPiece();
    if (pair >= params.tiles / 2) return;
    uvec2 at = tilePair(pair);
    uint tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    vec2 left[3], right[3];  // per my, both tiles
    [[unroll]] for (uint my = 0; my < 3; ++my) {
        vec2 m[3];
        [[unroll]] for (uint mx = 0; mx < 3; ++mx)
            m[mx] = unpackPair(matrices.d[place(3 * my + mx, channel(), tile, params.channels) / 2]);
        left[my] = m[0] + m[1];
        right[my] = m[1] - m[2];
    }
    float b = kBias ? bias.d[channel()] : 0;
    [[unroll]] for (uint r = 0; r < 2; ++r) {
        vec2 l = (r == 0 ? left[0] + left[1] : left[1] - left[2]) + b;
        vec2 n = (r == 0 ? right[0] + right[1] : right[1] - right[2]) + b;
        uint pixel = plane() + (2 * at.y + r) * params.width + 4 * at.x;
        result.d[pixel / 2] = packPair(vec2(l.x, n.x));
        result.d[pixel / 2 + 1] = packPair(vec2(l.y, n.y));
    }
}

// Row my of the tiles in tile row y, one phase: what four pixels get that are two apart. For px = 1
// they are the pair's first, third, …, and the tile to the left reaches into the first; for px = 0
// the second, fourth, …, and the tile to the right into the last.
vec4 along(uint row, uint my, uint px, uint x, uint y) {
    uint pairs = params.byRow.divisor, tilesDown = params.height / 4;
    if (y >= tilesDown) return vec4(0);
    uint first = gl_WorkGroupID.z * params.tiles + 2 * (y * pairs + x);
    uint rows = 4 * params.channels;
    vec2 m[3];
    [[unroll]] for (uint mx = 0; mx < 3; ++mx)
        m[mx] = unpackPair(matrices.d[place(3 * my + mx, row, first, rows) / 2]);
    vec2 inner = m[1] + m[2] - m[0];
    float between = m[0].y - m[2].x;
    if (px == 1) {
        vec2 beside = unpackPair(matrices.d[place(3 * my + 2, row, x > 0 ? first - 2 : first, rows) / 2]);
        return vec4(m[0].x - (x > 0 ? beside.y : 0), inner.x, between, inner.y);
    }
    bool inside = x + 1 < pairs;
    vec2 beside = unpackPair(matrices.d[place(3 * my, row, inside ? first + 2 : first, rows) / 2]);
    return vec4(inner.x, between, inner.y, (inside ? beside.x : 0) - m[2].y);
}

// B of the nine products (+ bias): 4x8 pixels of the finer image, from the tiles over them. The
// piece is the whole image.
ENTRY(fine_from_tiles) {
    uint pair = pairInPiece();
    if (pair >= params.tiles / 2) return;
    uvec2 at = tilePair(pair);
    float b = kBias ? bias.d[channel()] : 0;
    [[unroll]] for (uint py = 0; py < 2; ++py) {
        vec4 pixels[2][2];  // row, px
        [[unroll]] for (uint px = 0; px < 2; ++px) {
            uint row = 4 * channel() + 2 * py + px;
            vec4 first = along(row, 0, px, at.x, at.y), last = along(row, 2, px, at.x, at.y);
            vec4 inner = along(row, 1, px, at.x, at.y) + last - first;
            if (py == 1) {
                pixels[0][px] = first - along(row, 2, px, at.x, at.y - 1);
                pixels[1][px] = inner;
            } else {
                pixels[0][px] = inner;
                pixels[1][px] = along(row, 0, px, at.x, at.y + 1) - last;
            }
        }
        [[unroll]] for (uint r = 0; r < 2; ++r) {
            uint pixel = plane() + (4 * at.y + 2 * r + 1 - py) * params.width + 8 * at.x;
            [[unroll]] for (uint i = 0; i < 4; ++i)
                result.d[pixel / 2 + i] =
                    packPair(vec2(pixels[r][1][i], pixels[r][0][i]) + b);
        }
    }
}
