// loss = sum |predicted - target| mask / sum mask: the mask counts pixels, the difference all
// channels; L_pt of Gomes et al., WACV 2022, section 3.2. Backward: sign(predicted - target) mask /
// sum mask. What the mask leaves out may be anything, a NaN too. Sums have a fixed order.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "loss/params.h"
#include "loss/reduce.glsl"
PARAMS(MaskedL1LossParams, 8)
BUFFER(0, readonly, float, predicted);         // [n,channels]
BUFFER(1, readonly, float, target);            // [n,channels]
BUFFER(2, readonly, float, mask);              // [n]
BUFFER(3, readwrite, vec2, partial);           // [partials] differences, mask
BUFFER(4, readwrite, float, maskSum);          // [1]
BUFFER(5, writeonly, float, loss);             // [1]
BUFFER(6, readonly, float, dLoss);             // [1]
BUFFER(7, writeonly, float, dPredicted);       // [n,channels]

ENTRY(sums) {
    uint k = linearIndex();
    if (k >= params.partials) return;
    vec2 sum = vec2(0);
    for (uint i = k; i < params.n; i += params.partials) {
        float m = mask.d[i], difference = 0;
        if (m == 0) continue;
        for (uint c = i * params.channels; c < (i + 1) * params.channels; ++c)
            difference += abs(predicted.d[c] - target.d[c]);
        sum += vec2(m * difference, m);
    }
    partial.d[k] = sum;
}

ENTRY(finish) {
    SUM_PARTIALS(sum);
    if (localIndex() > 0) return;
    maskSum.d[0] = sum.y;
    loss.d[0] = sum.y == 0 ? 0 : sum.x / sum.y;
}

// One invocation per pixel.
ENTRY(backward) {
    float sum = maskSum.d[0], scale = dLoss.d[0];
    uint pixel = linearIndex();
    if (pixel >= params.n) return;
    float m = mask.d[pixel];
    for (uint c = pixel * params.channels; c < (pixel + 1) * params.channels; ++c) {
        float d = sum == 0 || m == 0 ? 0 : sign(predicted.d[c] - target.d[c]) * m / sum;
        dPredicted.d[c] = scale * d;
    }
}
