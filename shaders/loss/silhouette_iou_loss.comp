#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "loss/params.h"
#include "loss/reduce.glsl"
// 1 - sum p g / sum (p + g - p g)
PARAMS(SilhouetteIouLossParams, 7)
BUFFER(0, readonly, float, predicted);    // [n]
BUFFER(1, readonly, float, target);       // [n]
BUFFER(2, readwrite, vec2, partial);      // [partials] intersection, union
BUFFER(3, readwrite, vec2, total);        // [1]
BUFFER(4, writeonly, float, loss);        // [1]
BUFFER(5, readonly, float, dLoss);        // [1]
BUFFER(6, writeonly, float, dPredicted);  // [n]

ENTRY(sums) {
    uint k = linearIndex();
    if (k >= params.partials) return;
    vec2 sum = vec2(0);
    for (uint i = k; i < params.n; i += params.partials) {
        float p = predicted.d[i], g = target.d[i];
        sum += vec2(p * g, p + g - p * g);
    }
    partial.d[k] = sum;
}

ENTRY(finish) {
    vec2 mine = vec2(0);
    for (uint k = gl_LocalInvocationID.x; k < params.partials; k += gl_WorkGroupSize.x)
        mine += partial.d[k];
    vec2 sum = workgroupSum(mine);
    if (gl_LocalInvocationID.x > 0) return;
    total.d[0] = sum;
    loss.d[0] = sum.y == 0 ? 0 : 1 - sum.x / sum.y;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    vec2 sum = total.d[0];
    float g = target.d[i];
    float d = sum.y == 0 ? 0 : (sum.x / sum.y * (1 - g) - g) / sum.y;
    dPredicted.d[i] = dLoss.d[0] * d;
}
