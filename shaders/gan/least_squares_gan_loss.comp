// loss = mean over the logits of (x - label)^2, dx = 2 (x - label) dloss / n: Mao et al., Least
// Squares Generative Adversarial Networks, ICCV 2017, equation 2 without its factor of a half.
// label is 1 for "real", 0 for "fake".
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

float valueAt(float v) { return (v - params.label) * (v - params.label); }
float slopeAt(float v) { return 2 * (v - params.label); }

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
