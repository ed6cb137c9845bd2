// loss = sum |predicted - target| mask / sum mask: the mask counts pixels, the difference all
// channels; L_pt of Gomes et al., WACV 2022, section 3.2. Backward: sign(predicted - target) mask /
// sum mask. What the mask leaves out may be anything, a NaN too. Sums have a fixed order.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "loss/params.h"
#include "loss/reduce.glsl"
PARAMS(MaskedL1LossParams, 12)
BUFFER(0, readonly, float, predicted);         // [n,channels]
BUFFER(1, readonly, float, target);            // [n,channels]
BUFFER(2, readonly, float, mask);              // [n]
BUFFER(3, readwrite, vec2, partial);           // [partials] differences, mask
BUFFER(4, readwrite, float, maskSum);          // [1]
BUFFER(5, writeonly, float, loss);             // [1]
BUFFER(6, readonly, float, dLoss);             // [1]
BUFFER(7, writeonly, float, dPredicted);       // [n,channels]
BUFFER(8, readonly, uint64_t, predictedPairs);  // the same, in pairs
BUFFER(9, readonly, uint64_t, targetPairs);
BUFFER(10, readonly, uint64_t, maskPairs);
BUFFER(11, writeonly, uint64_t, dPredictedPairs);

const uint kEach = 4;  // pairs of pixels in the body of a loop

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

vec2 difference(uint i) {
    return unpackPair(predictedPairs.d[i]) - unpackPair(targetPairs.d[i]);
}

// Three channels, an even number of pixels.
ENTRY(sums_pairs) {
    uint k = linearIndex(), count = params.n / 2, stride = params.partials;
    if (k >= stride) return;
    vec2 sum = vec2(0);
    for (uint first = k; first < count; first += kEach * stride) {
        [[unroll]] for (uint e = 0; e < kEach; ++e) {
            uint at = first + e * stride, i = min(at, count - 1);
            vec2 m = at < count ? unpackPair(maskPairs.d[i]) : vec2(0);
            vec2 a = abs(difference(3 * i)), b = abs(difference(3 * i + 1));
            vec2 c = abs(difference(3 * i + 2));
            vec2 both = vec2(a.x + a.y + b.x, b.y + c.x + c.y);
            // What the mask leaves out may be anything, a NaN too.
            both = mix(m * both, vec2(0), equal(m, vec2(0)));
            sum += vec2(both.x + both.y, m.x + m.y);
        }
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

// One per two pixels.
ENTRY(backward_pairs) {
    float sum = maskSum.d[0], scale = dLoss.d[0];
    uint i = linearIndex();
    if (i >= params.n / 2) return;
    vec2 m = unpackPair(maskPairs.d[i]);
    vec2 weight = sum == 0 ? vec2(0) : m / sum;
    vec2 a = sign(difference(3 * i)), b = sign(difference(3 * i + 1));
    vec2 c = sign(difference(3 * i + 2));
    vec3 left = m.x == 0 ? vec3(0) : scale * (vec3(a, b.x) * weight.x);
    vec3 right = m.y == 0 ? vec3(0) : scale * (vec3(b.y, c) * weight.y);
    dPredictedPairs.d[3 * i] = packPair(left.xy);
    dPredictedPairs.d[3 * i + 1] = packPair(vec2(left.z, right.x));
    dPredictedPairs.d[3 * i + 2] = packPair(right.yz);
}
