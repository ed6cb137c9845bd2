// y[n, p] = sum over c of weight_c (a_c / |a| - b_c / |b|)^2, a and b being the features of a
// pixel, each scaled to unit length: Zhang et al., The Unreasonable Effectiveness of Deep Features
// as a Perceptual Metric (CVPR 2018), equation 1, before the mean over the pixels. No gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "features/params.h"
PARAMS(FeatureDistanceParams, 4)
BUFFER(0, readonly, float, a);       // [N, channels, pixels]
BUFFER(1, readonly, float, b);       // [N, channels, pixels]
BUFFER(2, readonly, float, weight);  // [channels]
BUFFER(3, writeonly, float, y);      // [N, pixels]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint first = i / params.pixels * params.channels * params.pixels + i % params.pixels;
    float aa = 0, bb = 0;
    for (uint c = 0; c < params.channels; ++c) {
        float u = a.d[first + c * params.pixels], v = b.d[first + c * params.pixels];
        aa += u * u;
        bb += v * v;
    }
    float scaleA = 1 / (sqrt(aa) + 1e-10), scaleB = 1 / (sqrt(bb) + 1e-10);
    float sum = 0;
    for (uint c = 0; c < params.channels; ++c) {
        // Of one picture twice this is 0, which a fused multiply-add of one product alone would miss.
        precise float u = a.d[first + c * params.pixels] * scaleA;
        precise float v = b.d[first + c * params.pixels] * scaleB;
        float d = u - v;
        sum += weight.d[c] * d * d;
    }
    y.d[i] = sum;
}
