#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "conv/params.h"
// Winograd's way for convolutions 4x4 of stride 1, the one of conv/winograd.glsl applied twice.
//
// In one dimension, c[o] = sum over t < 4 of w[t] f[o + t]. Split results by their parity r, taps by
// their parity p: blocks of correlations g_p = (w[p], w[2 + p]) over f_q = f[q], f[2 + q], …:
//     c_0 = f_0 * g_0 + f_1 * g_1 = M0 + M1,  c_1 = f_1 * g_0 + f_0' * g_1 = M1 - M2,
//     M0 = (f_0 - f_1) * g_0,  M1 = f_1 * (g_0 + g_1),  M2 = (f_1 - f_0') * g_1,
// f_0' being f_0 one step on; and each M with its two taps by three products for two results. That
// is nine products for the sixteen of four results, in two dimensions 81 for 256. A kernel 3x3 is
// one with w[3] = 0, so that the last of the nine products is too: 64 for 144.
//
// Matrices: kSide^2 [channels, tiles]; a tile has 4x4 results from 7x7 pixels.
PARAMS(WinogradParams, 4)
BUFFER(0, readonly, float, image);      // [images, channels, height, width]
BUFFER(1, readwrite, float, matrices);
BUFFER(2, writeonly, float, result);    // as image
BUFFER(3, readonly, float, bias);       // [channels]

layout(constant_id = 1) const uint kLayout = 0;  // as in conv/winograd.comp
layout(constant_id = 2) const uint kWidth = 32;
layout(constant_id = 3) const bool kBias = false;
layout(constant_id = 4) const uint kSide = 9;  // products in one dimension; 8 of a kernel 3x3
const uint kRows = 0, kTilePanels = 1, kRowPanels = 2;

// Workgroups: x tiles, y channels, z images.
uint tileInPiece() { return gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x; }
uint channel() { return gl_WorkGroupID.y; }  // from this dispatch's first
uvec2 tileCorner(uint tile) {
    uint at = params.firstTile + tile, row = quotient(at, params.byRow);
    return 4 * uvec2(remainder(at, row, params.byRow), row);
}
uint plane() {
    return params.startImage + (gl_WorkGroupID.z * params.channels + params.firstChannel + channel()) *
                                   params.height * params.width;
}
uint place(uint matrix, uint tile) {
    uint tiles = params.images * params.tiles, row = channel(), at = row * tiles + tile;
    if (kLayout == kTilePanels)
        at = (tile / kWidth * params.partChannels + row) * kWidth + tile % kWidth;
    if (kLayout == kRowPanels)
        at = (row / kWidth * params.panelSteps + tile) * kWidth + row % kWidth;
    return matrix * params.strideMatrix + at;
}

vec3 threeOf(vec3 u) { return vec3(u.x - u.y, u.y, u.y - u.z); }

// B^T f of seven pixels in a row.
void toNine(float f[7], out float u[9]) {
    vec3 a = threeOf(vec3(f[0] - f[1], f[2] - f[3], f[4] - f[5]));
    vec3 b = threeOf(vec3(f[1], f[3], f[5]));
    vec3 c = threeOf(vec3(f[1] - f[2], f[3] - f[4], f[5] - f[6]));
    [[unroll]] for (uint i = 0; i < 3; ++i) {
        u[i] = a[i];
        u[3 + i] = b[i];
        u[6 + i] = c[i];
    }
}

// A^T m: four results.
vec4 fromNine(float m[9]) {
    vec2 a = vec2(m[0] + m[1], m[1] - m[2]), b = vec2(m[3] + m[4], m[4] - m[5]);
    vec2 c = vec2(m[6] + m[7], m[7] - m[8]);
    return vec4(a.x + b.x, b.x - c.x, a.y + b.y, b.y - c.y);
}

// A c of four results.
void spread(vec4 c, out float u[9]) {
    vec2 parts[3] = vec2[3](c.xz, c.xz + c.yw, -c.yw);
    [[unroll]] for (uint k = 0; k < 3; ++k) {
        u[3 * k] = parts[k].x;
        u[3 * k + 1] = parts[k].x + parts[k].y;
        u[3 * k + 2] = -parts[k].y;
    }
}

ENTRY(image_to_tiles) {
    uint tile = tileInPiece();
    if (tile >= params.tiles) return;
    uvec2 corner = tileCorner(tile) - params.padding;  // outside, positions wrap to large ones
    uint start = plane(), to = gl_WorkGroupID.z * params.tiles + tile;
    float across[7][9];
    [[unroll]] for (uint r = 0; r < 7; ++r) {
        float f[7];
        [[unroll]] for (uint i = 0; i < 7; ++i) {
            bool inside = corner.y + r < params.height && corner.x + i < params.width;
            float v = image.d[start + (inside ? (corner.y + r) * params.width + corner.x + i : 0)];
            f[i] = inside ? v : 0;
        }
        toNine(f, across[r]);
    }
    [[unroll]] for (uint mx = 0; mx < kSide; ++mx) {
        float f[7], u[9];
        [[unroll]] for (uint r = 0; r < 7; ++r) f[r] = across[r][mx];
        toNine(f, u);
        [[unroll]] for (uint my = 0; my < kSide; ++my)
            matrices.d[place(kSide * my + mx, to)] = u[my];
    }
}

ENTRY(results_to_tiles) {
    uint tile = tileInPiece();
    if (tile >= params.tiles) return;
    uvec2 corner = tileCorner(tile);
    uint start = plane(), to = gl_WorkGroupID.z * params.tiles + tile;
    float across[4][9];
    [[unroll]] for (uint r = 0; r < 4; ++r) {
        vec4 c;
        [[unroll]] for (uint i = 0; i < 4; ++i) {
            bool inside = corner.y + r < params.height && corner.x + i < params.width;
            float v = image.d[start + (inside ? (corner.y + r) * params.width + corner.x + i : 0)];
            c[i] = inside ? v : 0;
        }
        spread(c, across[r]);
    }
    [[unroll]] for (uint mx = 0; mx < kSide; ++mx) {
        float u[9];
        spread(vec4(across[0][mx], across[1][mx], across[2][mx], across[3][mx]), u);
        [[unroll]] for (uint my = 0; my < kSide; ++my)
            matrices.d[place(kSide * my + mx, to)] = u[my];
    }
}

ENTRY(results_from_tiles) {
    uint tile = tileInPiece();
    if (tile >= params.tiles) return;
    uvec2 corner = tileCorner(tile);
    uint start = plane(), from = gl_WorkGroupID.z * params.tiles + tile;
    vec4 down[9];  // per mx, four rows
    down[8] = vec4(0);
    [[unroll]] for (uint mx = 0; mx < kSide; ++mx) {
        float m[9];
        m[8] = 0;
        [[unroll]] for (uint my = 0; my < kSide; ++my)
            m[my] = matrices.d[place(kSide * my + mx, from)];
        down[mx] = fromNine(m);
    }
    float b = kBias ? bias.d[params.firstChannel + channel()] : 0;
    [[unroll]] for (uint r = 0; r < 4; ++r) {
        float m[9];
        [[unroll]] for (uint mx = 0; mx < 9; ++mx) m[mx] = down[mx][r];
        vec4 c = fromNine(m) + b;
        [[unroll]] for (uint i = 0; i < 4; ++i)
            if (corner.y + r < params.height && corner.x + i < params.width)
                result.d[start + (corner.y + r) * params.width + corner.x + i] = c[i];
    }
}
