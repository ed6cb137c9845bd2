#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "conv/params.h"
// The weights of conv/winograd_dense.comp.
PARAMS(WinogradWeightsParams, 2)
BUFFER(0, readwrite, float, weight);    // [features, channels, kKernel, kKernel]
BUFFER(1, readwrite, float, matrices);  // [features, channels] each; kTurned: [channels, features]

// For the gradient of the image: the kernels turned by half a turn, features and channels swapped.
layout(constant_id = 1) const bool kTurned = false;
layout(constant_id = 2) const uint kKernel = 4;  // or 3
layout(constant_id = 3) const uint kSide = 9;
layout(constant_id = 4) const uint kWidth = 32;  // of a panel of to_tiles, see conv/winograd_weights
const uint kTaps = kKernel * kKernel;

void nineOf(float w[4], out float u[9]) {
    vec2 g[3] = vec2[3](vec2(w[0], w[2]), vec2(w[0] + w[1], w[2] + w[3]), vec2(w[1], w[3]));
    [[unroll]] for (uint k = 0; k < 3; ++k) {
        u[3 * k] = g[k].x;
        u[3 * k + 1] = g[k].x + g[k].y;
        u[3 * k + 2] = g[k].y;
    }
}

vec4 fourOf(float s[9]) {
    vec2 a = vec2(s[0] + s[1], s[1] + s[2]), b = vec2(s[3] + s[4], s[4] + s[5]);
    vec2 c = vec2(s[6] + s[7], s[7] + s[8]);
    return vec4(a.x + b.x, b.x + c.x, a.y + b.y, b.y + c.y);
}

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
        nineOf(w, across[r]);
    }
    [[unroll]] for (uint mx = 0; mx < kSide; ++mx) {
        float u[9];
        nineOf(float[4](across[0][mx], across[1][mx], across[2][mx], across[3][mx]), u);
        [[unroll]] for (uint my = 0; my < kSide; ++my)
            matrices.d[(kSide * my + mx) * params.strideMatrix + to] = u[my];
    }
}

ENTRY(from_tiles) {
    uint i = linearIndex();
    if (i >= params.invocations) return;
    vec4 down[9];
    down[8] = vec4(0);
    [[unroll]] for (uint mx = 0; mx < kSide; ++mx) {
        float s[9];
        s[8] = 0;
        [[unroll]] for (uint my = 0; my < kSide; ++my)
            s[my] = matrices.d[(kSide * my + mx) * params.strideMatrix + i];
        down[mx] = fourOf(s);
    }
    [[unroll]] for (uint r = 0; r < kKernel; ++r) {
        float s[9];
        [[unroll]] for (uint mx = 0; mx < 9; ++mx) s[mx] = down[mx][r];
        vec4 w = fourOf(s);
        [[unroll]] for (uint k = 0; k < kKernel; ++k) weight.d[kTaps * (params.first * params.channels + i) + kKernel * r + k] = w[k];
    }
}
