// A convolution of each channel c by itself,
//
//     y[c,i,j] = bias[c] + sum over u, v < K of w[c,u,v] x[c, S i + u - top, S j + v - left],
//
// zeros outside x, or the least of 6 and its positive part (Howard and others, MobileNets, 2017).
// An invocation makes four neighbours of kRows rows, so that a value is loaded once for all of
// them that need it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "inference/params.h"
PARAMS(DepthwiseParams, 5)
BUFFER(0, readonly, vec4, weight);   // [C, texels of four]: w row by row, then the bias, then zeros
BUFFER(1, readonly, float, x);       // [C,H,W]
BUFFER(2, readonly, vec4, xQuads);   // x again
BUFFER(3, writeonly, float, y);      // [C,H',W']
BUFFER(4, writeonly, vec4, yQuads);  // y again

layout(constant_id = 1) const uint kKernel = 3;
layout(constant_id = 2) const uint kStride = 1;
layout(constant_id = 3) const uint kLeft = 1;  // padding
layout(constant_id = 4) const uint kRows = 1;  // of y; they divide its height
layout(constant_id = 5) const bool kRelu6 = false;
layout(constant_id = 6) const bool kTexels = false;  // rows of x and y are whole texels

const uint kTaps = kKernel * kKernel;
const uint kWeightQuads = (kTaps + 4) / 4;
const uint kSpan = 3 * kStride + kKernel;   // columns of x that four of y need
const uint kBefore = (kLeft + 3) / 4;       // texels of them left of the first's
const uint kShift = kTexels ? 4 * kBefore - kLeft : 0;
const uint kWindowQuads = (kShift + kSpan + 3) / 4;

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint rest = quotient(i, params.byColumns), column = remainder(i, rest, params.byColumns);
    uint channel = quotient(rest, params.byRows), group = remainder(rest, channel, params.byRows);
    int width = int(params.width), height = int(params.height);

    vec4 w[kWeightQuads];
    [[unroll]] for (uint t = 0; t < kWeightQuads; ++t)
        w[t] = weight.d[channel * kWeightQuads + t];
    float bias = w[kTaps / 4][kTaps % 4];
    vec4 sum[kRows];
    [[unroll]] for (uint r = 0; r < kRows; ++r) sum[r] = vec4(bias);

    int first = int(group * kRows * kStride) - int(params.paddingTop);
    int texel = int(column * kStride) - int(kBefore);
    int left = int(4 * column * kStride) - int(kLeft);
    uint base = channel * params.height * params.width;
    [[unroll]] for (uint u = 0; u < (kRows - 1) * kStride + kKernel; ++u) {
        int row = first + int(u);
        bool inside = row >= 0 && row < height;
        uint start = base + uint(clamp(row, 0, height - 1) * width);
        vec4 window[kWindowQuads];
        [[unroll]] for (uint t = 0; t < kWindowQuads; ++t) {
            if (kTexels) {
                int at = texel + int(t);
                vec4 v = xQuads.d[start / 4 + uint(clamp(at, 0, width / 4 - 1))];
                window[t] = inside && at >= 0 && at < width / 4 ? v : vec4(0);
            } else {
                [[unroll]] for (uint e = 0; e < 4; ++e) {
                    int at = left + int(4 * t + e);
                    float v = 0;
                    if (4 * t + e < kSpan) v = x.d[start + uint(clamp(at, 0, width - 1))];
                    window[t][e] = inside && at >= 0 && at < width ? v : 0;
                }
            }
        }
        [[unroll]] for (uint r = 0; r < kRows; ++r) {
            if (u < r * kStride || u >= r * kStride + kKernel) continue;
            [[unroll]] for (uint v = 0; v < kKernel; ++v) {
                uint tap = (u - r * kStride) * kKernel + v;
                [[unroll]] for (uint e = 0; e < 4; ++e) {
                    uint at = kShift + e * kStride + v;
                    sum[r][e] += w[tap / 4][tap % 4] * window[at / 4][at % 4];
                }
            }
        }
    }
    uint out0 = (channel * params.outHeight + group * kRows) * params.outWidth + 4 * column;
    [[unroll]] for (uint r = 0; r < kRows; ++r) {
        vec4 v = sum[r];
        if (kRelu6) v = clamp(v, vec4(0), vec4(6));
        uint at = out0 + r * params.outWidth;
        if (kTexels) {
            yQuads.d[at / 4] = v;
        } else {
            [[unroll]] for (uint e = 0; e < 4; ++e)
                if (4 * column + e < params.outWidth) y.d[at + e] = v[e];
        }
    }
}
