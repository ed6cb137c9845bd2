#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "conv/params.h"
#include "conv/winograd_dense.glsl"
// The weights of conv/winograd_dense.comp.
PARAMS(WinogradWeightsParams, 2)
BUFFER(0, readwrite, float, weight);    // [features, channels, kKernel, kKernel]
BUFFER(1, readwrite, float, matrices);  // [features, channels] each; kTurned: [channels, features]

// For the gradient of the image: the kernels turned by half a turn, features and channels swapped.
layout(constant_id = 2) const bool kTurned = false;
layout(constant_id = 3) const uint kWidth = 32;  // of a panel of to_tiles, see conv/winograd_weights
const uint kKernel = kSide == 6 ? 3 : 4;
const uint kTaps = kKernel * kKernel;

// One invocation per feature and channel, in the order of the panels (linalg/gemm.glsl).
ENTRY(to_tiles) {
    uint i = linearIndex();
    if (i >= params.invocations) return;
    uint panel = quotient(i / kWidth, params.bySteps);
    uint step = remainder(i / kWidth, panel, params.bySteps), row = panel * kWidth + i % kWidth;
    uint of = params.first + row;
    if (of >= (kTurned ? params.channels : params.features)) return;
    uint from = kTurned ? step * params.channels + of : of * params.channels + step;
    uint to = (row / kWidth * params.panelSteps + step) * kWidth + row % kWidth;
    float across[4][9];
    [[unroll]] for (uint r = 0; r < 4; ++r) {
        float w[4];
        [[unroll]] for (uint k = 0; k < 4; ++k) {
            uint tap = kKernel * r + k;
            w[k] = 0;
            if (r < kKernel && k < kKernel)
                w[k] = weight.d[kTaps * from + (kTurned ? kTaps - 1 - tap : tap)];
        }
        tapsToPoints(w, across[r]);
    }
    [[unroll]] for (uint mx = 0; mx < kSide; ++mx) {
        float u[9];
        tapsToPoints(float[4](across[0][mx], across[1][mx], across[2][mx], across[3][mx]), u);
        [[unroll]] for (uint my = 0; my < kSide; ++my)
            matrices.d[(kSide * my + mx) * params.strideMatrix + to] = u[my];
    }
}

ENTRY(from_tiles) {
    uint i = linearIndex();
    if (i >= params.invocations) return;
    vec4 down[9];
    [[unroll]] for (uint mx = 0; mx < kSide; ++mx) {
        float s[9];
        [[unroll]] for (uint my = 0; my < kSide; ++my)
            s[my] = matrices.d[(kSide * my + mx) * params.strideMatrix + i];
        down[mx] = tapsFromPoints(s);
    }
    [[unroll]] for (uint r = 0; r < kKernel; ++r) {
        float s[9];
        [[unroll]] for (uint mx = 0; mx < kSide; ++mx) s[mx] = down[mx][r];
        vec4 w = tapsFromPoints(s);
        uint tap = kTaps * (params.first * params.channels + i) + kKernel * r;
        [[unroll]] for (uint k = 0; k < kKernel; ++k) weight.d[tap + k] = w[k];
    }
}
