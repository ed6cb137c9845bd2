#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "conv/params.h"
#include "conv/winograd.glsl"
PARAMS(WinogradParams, 4)
BUFFER(0, readonly, uint64_t, image);      // [images, channels, height, width] in pairs
BUFFER(1, readwrite, uint64_t, matrices);  // nine, in pairs of tiles or of rows
BUFFER(2, writeonly, uint64_t, result);    // as image
BUFFER(3, readonly, float, bias);          // [channels]

// How the matrices lie: row by row; or as the right side of a product (linalg/gemm.glsl) in panels
// of kWidth tiles, or of kWidth rows.
layout(constant_id = 1) const uint kLayout = 0;
layout(constant_id = 2) const uint kWidth = 32;  // a power of two
layout(constant_id = 3) const bool kBias = false;
const uint kRows = 0, kTilePanels = 1, kRowPanels = 2;

// Workgroups: x pairs of tiles side by side, y channels, z images.
uint pairInPiece() { return gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x; }
uint channel() { return gl_WorkGroupID.y; }
// Tile row and pair within it.
uvec2 tilePair(uint pair) {
    uint at = params.firstTile / 2 + pair, row = quotient(at, params.byRow);
    return uvec2(remainder(at, row, params.byRow), row);
}
uint plane() {
    return params.startImage +
           (gl_WorkGroupID.z * params.channels + channel()) * params.height * params.width;
}

// Of a matrix: the element of a row and a tile of the piece.
uint place(uint matrix, uint row, uint tile, uint rows) {
    uint tiles = params.images * params.tiles, at = row * tiles + tile;
    if (kLayout == kTilePanels) at = (tile / kWidth * rows + row) * kWidth + tile % kWidth;
    if (kLayout == kRowPanels) at = (row / kWidth * tiles + tile) * kWidth + row % kWidth;
    return matrix * params.strideMatrix + at;
}

// B^T f: per tile of 6x6 pixels and phase.
ENTRY(fine_to_tiles) {
    uint pair = pairInPiece();
    if (pair >= params.tiles / 2) return;
    uvec2 at = tilePair(pair);
    uint start = plane(), tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    uint rows = 4 * params.channels;
    vec3 across[2][6][2];  // tile, row of pixels, px
    [[unroll]] for (uint r = 0; r < 6; ++r) {
        // Outside, positions wrap to large ones.
        uint y = 4 * at.y + r - 1, x = 8 * at.x - 2;
        float v[12];
        [[unroll]] for (uint i = 0; i < 6; ++i) {
            bool inside = y < params.height && x + 2 * i < params.width;
            vec2 loaded = unpackPair(image.d[(start + (inside ? y * params.width + x + 2 * i : 0)) / 2]);
            v[2 * i] = inside ? loaded.x : 0;
            v[2 * i + 1] = inside ? loaded.y : 0;
        }
        [[unroll]] for (uint t = 0; t < 2; ++t)
            [[unroll]] for (uint px = 0; px < 2; ++px) {
                uint first = 1 + 4 * t + px;
                across[t][r][px] = vec3(v[first] - v[first + 2], v[first + 2],
                                        v[first + 2] - v[first + 4]);
            }
    }
    [[unroll]] for (uint py = 0; py < 2; ++py)
        [[unroll]] for (uint my = 0; my < 3; ++my) {
            vec3 u[2][2];  // tile, px
            [[unroll]] for (uint t = 0; t < 2; ++t)
                [[unroll]] for (uint px = 0; px < 2; ++px) {
                    vec3 middle = across[t][2 + py][px];
                    u[t][px] = my == 0   ? across[t][py][px] - middle
                               : my == 1 ? middle
                                         : middle - across[t][4 + py][px];
                }
            uint row = 4 * channel() + 2 * py;
            [[unroll]] for (uint mx = 0; mx < 3; ++mx)
                [[unroll]] for (uint i = 0; i < 2; ++i) {
                    vec2 v = kLayout == kRowPanels ? vec2(u[i][0][mx], u[i][1][mx])
                                                   : vec2(u[0][i][mx], u[1][i][mx]);
                    uint to = kLayout == kRowPanels ? place(3 * my + mx, row, tile + i, rows)
                                                    : place(3 * my + mx, row + i, tile, rows);
                    matrices.d[to / 2] = packPair(v);
                }
        }
}

// A c: per tile of 2x2 pixels.
ENTRY(coarse_to_tiles) {
    uint pair = pairInPiece();
    if (pair >= params.tiles / 2) return;
    uvec2 at = tilePair(pair);
    uint tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    vec2 c[2][2];  // tile, row of pixels
    [[unroll]] for (uint r = 0; r < 2; ++r)
        [[unroll]] for (uint t = 0; t < 2; ++t) {
            uint pixel = plane() + (2 * at.y + r) * params.width + 4 * at.x + 2 * t;
            c[t][r] = unpackPair(image.d[pixel / 2]);
        }
    [[unroll]] for (uint my = 0; my < 3; ++my) {
        vec2 row[2];
        [[unroll]] for (uint t = 0; t < 2; ++t)
            row[t] = my == 0 ? c[t][0] : my == 1 ? c[t][0] + c[t][1] : -c[t][1];
        vec2 left = vec2(row[0].x, row[1].x), right = vec2(row[0].y, row[1].y);
        [[unroll]] for (uint mx = 0; mx < 3; ++mx)
            matrices.d[place(3 * my + mx, channel(), tile, params.channels) / 2] =
                packPair(mx == 0 ? left : mx == 1 ? left + right : -right);
    }
}

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
