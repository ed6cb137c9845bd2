// loss = mean over the logits of softplus(-x) where the label is 1 ("real"), of softplus(x) where
// it is 0 ("fake"): -log D and -log(1 - D) with D = sigmoid(x), Goodfellow et al., Generative
// Adversarial Nets, NIPS 2014, equation 1. dx = -sigmoid(-x), or sigmoid(x), times dloss / n.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "gan/params.h"
#include "loss/reduce.glsl"
PARAMS(GanLossParams, 4)
BUFFER(0, readonly, float, x);       // [n] logits
BUFFER(1, writeonly, float, loss);   // [1]
BUFFER(2, readonly, float, dLoss);   // [1]
BUFFER(3, writeonly, float, dx);     // [n]

// softplus(z) = ln(1 + exp(z)), without overflow and without losing small values.
float valueAt(float v) {
    float z = params.label == 1 ? -v : v, e = exp(-abs(z));
    return max(z, 0) + (e < 1e-3 ? e * (1 - e * (0.5 - e / 3)) : log(1 + e));
}

float slopeAt(float v) {
    float z = params.label == 1 ? -v : v, e = exp(-abs(z));
    float s = (z > 0 ? 1 : e) / (1 + e);
    return params.label == 1 ? -s : s;
}

// One workgroup: logits are few.
ENTRY(mean) {
    vec2 sum = vec2(0);
    for (uint i = localIndex(); i < params.n; i += gl_WorkGroupSize.x) sum.x += valueAt(x.d[i]);
    sum = workgroupSum(sum);
    if (localIndex() == 0) loss.d[0] = sum.x / float(params.n);
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    dx.d[i] = dLoss.d[0] * slopeAt(x.d[i]) / float(params.n);
}
