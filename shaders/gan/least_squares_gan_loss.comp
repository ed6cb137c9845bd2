#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "gan/params.h"
#include "loss/reduce.glsl"
// mean (x - label)^2.
PARAMS(GanLossParams, 5)
BUFFER(0, readonly, float, x);         // [n] logits
BUFFER(1, readwrite, vec2, partial);   // [partials]
BUFFER(2, writeonly, float, loss);     // [1]
BUFFER(3, readonly, float, dLoss);     // [1]
BUFFER(4, writeonly, float, dx);       // [n]

float valueAt(float v) { return (v - params.label) * (v - params.label); }
float slopeAt(float v) { return 2 * (v - params.label); }

ENTRY(sums) {
    uint k = linearIndex();
    if (k >= params.partials) return;
    float sum = 0;
    for (uint i = k; i < params.n; i += params.partials) sum += valueAt(x.d[i]);
    partial.d[k] = vec2(sum, 0);
}

ENTRY(finish) {
    SUM_PARTIALS(sum);
    if (localIndex() == 0) loss.d[0] = sum.x / float(params.n);
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    dx.d[i] = dLoss.d[0] * slopeAt(x.d[i]) / float(params.n);
}
