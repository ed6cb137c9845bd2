// Winograd's transforms of weights of stride 1: G w, and of their gradients G^T s
// (conv/winograd.glsl has the algebra, the shapes and the source).
// Matrices u = G w [kPoints^2, rows, steps] of weights w [features, channels, taps, taps].
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/panels.h"
#include "conv/params.h"
#include "conv/winograd.glsl"
PARAMS(WinogradWeightsParams, 2)
BUFFER(0, readwrite, float, weight);    // [features, channels, kTaps, kTaps]
BUFFER(1, readwrite, float, matrices);  // [kPoints^2] of them; kTurned: of [channels, features]

// For the gradient of the image: the kernels turned by half a turn, features and channels swapped.
layout(constant_id = 2) const bool kTurned = false;
layout(constant_id = 3) const uint kWidth =
    32;  // of a panel of to_tiles, see conv/winograd_weights
const uint kKernel = kTaps * kTaps;

// One invocation per feature and channel, in the order of the panels (common/panels.h).
ENTRY(to_tiles) {
    uint i = linearIndex();
    if (i >= params.invocations) return;
    uint panel = quotient(i / kWidth, params.bySteps);
    uint step = remainder(i / kWidth, panel, params.bySteps), row = panel * kWidth + i % kWidth;
    uint of = params.first + row;
    if (of >= (kTurned ? params.channels : params.features)) return;
    uint from = kTurned ? step * params.channels + of : of * params.channels + step;
    uint to = panelIndex(row, step, params.panelSteps, kWidth);
    float across[4][kMostPoints];
    [[unroll]] for (uint r = 0; r < kTaps; ++r) {
        float w[4];
        [[unroll]] for (uint k = 0; k < kTaps; ++k) {
            uint tap = kTaps * r + k;
            w[k] = weight.d[kKernel * from + (kTurned ? kKernel - 1 - tap : tap)];
        }
        tapsToPoints(w, across[r]);
    }
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float u[kMostPoints];
        tapsToPoints(float[4](across[0][mx], across[1][mx], across[2][mx], across[3][mx]), u);
        [[unroll]] for (uint my = 0; my < kPoints; ++my)
            matrices.d[(kPoints * my + mx) * params.strideMatrix + to] = u[my];
    }
}

ENTRY(from_tiles) {
    uint i = linearIndex();
    if (i >= params.invocations) return;
    float down[kMostPoints][4];
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float s[kMostPoints];
        [[unroll]] for (uint my = 0; my < kPoints; ++my)
            s[my] = matrices.d[(kPoints * my + mx) * params.strideMatrix + i];
        tapsFromPoints(s, down[mx]);
    }
    [[unroll]] for (uint r = 0; r < kTaps; ++r) {
        float s[kMostPoints], w[4];
        [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) s[mx] = down[mx][r];
        tapsFromPoints(s, w);
        uint tap = kKernel * (params.first * params.channels + i) + kTaps * r;
        [[unroll]] for (uint k = 0; k < kTaps; ++k) weight.d[tap + k] = w[k];
    }
}
