// ssim = structural similarity of a and b [H,W,C] in [0,1], the mean over all elements of
//     (2 ma mb + C1) (2 sab + C2) / ((ma^2 + mb^2 + C1) (sa^2 + sb^2 + C2))
// with means m, variances s^2 and covariance sab under an 11x11 Gaussian window of sigma 1.5, which
// is separable; zero padding. Z. Wang et al., Image quality assessment: from error visibility to
// structural similarity, 2004, equation 13. The pictures enter less a half, which changes no
// variance and makes the differences of squares finer. Backward: to a.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "loss/params.h"
#include "loss/reduce.glsl"
PARAMS(SsimParams, 10)
BUFFER(0, readonly, float, a);           // [H,W,C]
BUFFER(1, readonly, float, b);           // [H,W,C]
BUFFER(2, readwrite, vec4, rows);        // [H,W,C] window along the row of a, b, a^2, b^2
BUFFER(3, readwrite, float, rowsAB);     // [H,W,C] of a b
BUFFER(4, readwrite, vec4, map);         // [H,W,C] ssim; its derivatives by E a, E a^2, E a b
BUFFER(5, readwrite, vec2, partial);     // [partials]
BUFFER(6, writeonly, float, ssim);       // [1]
BUFFER(7, readonly, float, dSsim);       // [1]
BUFFER(8, readwrite, vec4, dRows);       // [H,W,C] window along the row of the derivatives
BUFFER(9, writeonly, float, da);         // [H,W,C]

// exp(-k^2 / (2 1.5^2)), normalised: at distance 0, 1, ...
const float kWindow[6] = float[](0.266011725, 0.213005538, 0.109360690, 0.036000772,
                                 0.007598758, 0.001028380);
const int kReach = 5;
const float kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;

// Column and row of an element.
ivec2 place(uint i) {
    uint pixel = i / params.channels;
    return ivec2(pixel % params.width, pixel / params.width);
}

ENTRY(forward_rows) {
    uint i = linearIndex();
    if (i >= params.width * params.height * params.channels) return;
    int x = place(i).x;
    vec4 sum = vec4(0);
    float sumAB = 0;
    for (int k = -kReach; k <= kReach; ++k) {
        bool within = x + k >= 0 && x + k < int(params.width);
        uint j = uint(int(i) + (within ? k : 0) * int(params.channels));
        float va = (within ? a.d[j] : 0) - 0.5, vb = (within ? b.d[j] : 0) - 0.5;
        float weight = kWindow[abs(k)];
        sum += weight * vec4(va, vb, va * va, vb * vb);
        sumAB += weight * va * vb;
    }
    rows.d[i] = sum;
    rowsAB.d[i] = sumAB;
}

ENTRY(forward_columns) {
    uint i = linearIndex(), stride = params.width * params.channels;
    if (i >= stride * params.height) return;
    int y = place(i).y;
    vec4 sum = vec4(0);
    float sumAB = 0;
    for (int k = -kReach; k <= kReach; ++k) {
        bool within = y + k >= 0 && y + k < int(params.height);
        uint j = uint(int(i) + (within ? k : 0) * int(stride));
        // A row of padding: zeros, less a half.
        vec4 row = within ? rows.d[j] : vec4(-0.5, -0.5, 0.25, 0.25);
        float rowAB = within ? rowsAB.d[j] : 0.25;
        sum += kWindow[abs(k)] * row;
        sumAB += kWindow[abs(k)] * rowAB;
    }
    vec2 mean = sum.xy + 0.5;
    vec2 variance = sum.zw - sum.xy * sum.xy;
    float covariance = sumAB - sum.x * sum.y;
    float top1 = 2 * mean.x * mean.y + kC1, top2 = 2 * covariance + kC2;
    float bottom1 = dot(mean, mean) + kC1, bottom2 = variance.x + variance.y + kC2;
    float bottom = bottom1 * bottom2, s = top1 * top2 / bottom;
    // By the mean through what is not a variance, then through the variances (of the shifted a).
    float byMean = 2 * (mean.y * top2 / bottom - mean.x * s / bottom1) +
                   2 * (sum.x * s / bottom2 - sum.y * top1 / bottom);
    map.d[i] = vec4(s, byMean, -s / bottom2, 2 * top1 / bottom);
}

ENTRY(sums) {
    uint k = linearIndex();
    if (k >= params.partials) return;
    float sum = 0;
    uint n = params.width * params.height * params.channels;
    for (uint i = k; i < n; i += params.partials) sum += map.d[i].x;
    partial.d[k] = vec2(sum, 0);
}

ENTRY(finish) {
    SUM_PARTIALS(sum);
    if (localIndex() == 0)
        ssim.d[0] = sum.x / float(params.width * params.height * params.channels);
}

// The window is symmetric: the same filter takes the derivatives back to the pixels.
ENTRY(backward_rows) {
    uint i = linearIndex();
    if (i >= params.width * params.height * params.channels) return;
    int x = place(i).x;
    vec4 sum = vec4(0);
    for (int k = -kReach; k <= kReach; ++k)
        if (x + k >= 0 && x + k < int(params.width))
            sum += kWindow[abs(k)] * map.d[uint(int(i) + k * int(params.channels))];
    dRows.d[i] = sum;
}

ENTRY(backward_columns) {
    uint i = linearIndex(), stride = params.width * params.channels;
    uint n = stride * params.height;
    if (i >= n) return;
    int y = place(i).y;
    vec4 sum = vec4(0);
    for (int k = -kReach; k <= kReach; ++k)
        if (y + k >= 0 && y + k < int(params.height))
            sum += kWindow[abs(k)] * dRows.d[uint(int(i) + k * int(stride))];
    float va = a.d[i] - 0.5, vb = b.d[i] - 0.5;
    da.d[i] = dSsim.d[0] / float(n) * (sum.y + 2 * va * sum.z + vb * sum.w);
}
