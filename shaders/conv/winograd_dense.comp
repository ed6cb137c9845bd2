// Winograd's transforms of images and maps, for convolutions of stride 1: B f of the image, A c of
// the maps, and A^T (conv/winograd.glsl has the algebra, the shapes and the source). The gradient
// of the image is the convolution of the maps with the kernels turned by half a turn. An invocation
// makes one tile.
// maps = A^T [(G weight) (B image)], summed over channels: matrices [kPoints^2, rows, tiles].
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/panels.h"
#include "conv/params.h"
#include "conv/winograd.glsl"
PARAMS(WinogradParams, 4)
BUFFER(0, readonly, float, image);      // [images, channels, height, width]
BUFFER(1, readwrite, float, matrices);  // [kPoints^2, channels, tiles] as kLayout says
BUFFER(2, writeonly, float, result);    // as image
BUFFER(3, readonly, float, bias);       // [channels]

layout(constant_id = 2) const uint kLayout = 0;  // as in conv/winograd.comp
layout(constant_id = 3) const uint kWidth = 32;
layout(constant_id = 4) const bool kBias = false;

// Workgroups: x tiles, y channels from this dispatch's first; in panels of rows the other way
// round. z images.
uint alongX() { return gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x; }
uint tileInPiece() { return kLayout == kLayoutRowPanels ? gl_WorkGroupID.y : alongX(); }
uint channel() { return kLayout == kLayoutRowPanels ? alongX() : gl_WorkGroupID.y; }
bool isWork() { return tileInPiece() < params.tiles && channel() < params.partChannels; }
uvec2 tileCorner(uint tile) {
    uint at = params.firstTile + tile, row = quotient(at, params.byRow);
    return 4 * uvec2(remainder(at, row, params.byRow), row);
}
uint plane() {
    return params.startImage +
           (gl_WorkGroupID.z * params.channels + params.firstChannel + channel()) * params.height *
               params.width;
}
uint place(uint matrix, uint tile) {
    uint tiles = kLayout == kLayoutRowPanels ? params.panelSteps : params.images * params.tiles;
    return matrix * params.strideMatrix +
           elementIndex(kLayout, kWidth, channel(), tile, params.partChannels, tiles);
}

ENTRY(image_to_tiles) {
    if (!isWork()) return;
    uint tile = tileInPiece();
    uvec2 corner = tileCorner(tile) - params.padding;  // outside, positions wrap to large ones
    uint start = plane(), to = gl_WorkGroupID.z * params.tiles + tile;
    float across[kMostSeen][kMostPoints];
    [[unroll]] for (uint r = 0; r < kSeen; ++r) {
        float f[kMostSeen];
        [[unroll]] for (uint i = 0; i < kSeen; ++i) {
            bool inside = corner.y + r < params.height && corner.x + i < params.width;
            float v = image.d[start + (inside ? (corner.y + r) * params.width + corner.x + i : 0)];
            f[i] = inside ? v : 0;
        }
        toPoints(f, across[r]);
    }
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float f[kMostSeen], u[kMostPoints];
        [[unroll]] for (uint r = 0; r < kSeen; ++r) f[r] = across[r][mx];
        toPoints(f, u);
        [[unroll]] for (uint my = 0; my < kPoints; ++my)
            matrices.d[place(kPoints * my + mx, to)] = u[my];
    }
}

ENTRY(results_to_tiles) {
    if (!isWork()) return;
    uint tile = tileInPiece();
    uvec2 corner = tileCorner(tile);
    uint start = plane(), to = gl_WorkGroupID.z * params.tiles + tile;
    float across[4][kMostPoints];
    [[unroll]] for (uint r = 0; r < 4; ++r) {
        float c[4];
        [[unroll]] for (uint i = 0; i < 4; ++i) {
            bool inside = corner.y + r < params.height && corner.x + i < params.width;
            float v = image.d[start + (inside ? (corner.y + r) * params.width + corner.x + i : 0)];
            c[i] = inside ? v : 0;
        }
        toProducts(c, across[r]);
    }
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float u[kMostPoints];
        toProducts(float[4](across[0][mx], across[1][mx], across[2][mx], across[3][mx]), u);
        [[unroll]] for (uint my = 0; my < kPoints; ++my)
            matrices.d[place(kPoints * my + mx, to)] = u[my];
    }
}

ENTRY(results_from_tiles) {
    if (!isWork()) return;
    uint tile = tileInPiece();
    uvec2 corner = tileCorner(tile);
    uint start = plane(), from = gl_WorkGroupID.z * params.tiles + tile;
    float down[kMostPoints][4];  // per mx, four rows
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float m[kMostPoints];
        [[unroll]] for (uint my = 0; my < kPoints; ++my)
            m[my] = matrices.d[place(kPoints * my + mx, from)];
        fromProducts(m, down[mx]);
    }
    float b = kBias ? bias.d[params.firstChannel + channel()] : 0;
    [[unroll]] for (uint r = 0; r < 4; ++r) {
        float m[kMostPoints], c[4];
        [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) m[mx] = down[mx][r];
        fromProducts(m, c);
        [[unroll]] for (uint i = 0; i < 4; ++i)
            if (corner.y + r < params.height && corner.x + i < params.width)
                result.d[start + (corner.y + r) * params.width + corner.x + i] = c[i] + b;
    }
}
