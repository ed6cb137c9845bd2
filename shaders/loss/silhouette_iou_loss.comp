// loss = 1 - sum p g / sum (p + g - p g): soft intersection over union of a silhouette p and a mask
// g in [0,1], L_s of Gomes et al., WACV 2022, section 3.1. With intersection I and union U,
//     dp = -dloss (g U - (1 - g) I) / U^2.
// Sums have a fixed order; both empty gives 0.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "loss/params.h"
#include "loss/reduce.glsl"
PARAMS(SilhouetteIouLossParams, 7)
BUFFER(0, readonly, Pair, predicted);    // [n], in pairs
BUFFER(1, readonly, Pair, target);       // [n], in pairs
BUFFER(2, readwrite, vec2, partial);         // [partials] intersection, union
BUFFER(3, readwrite, vec2, total);           // [1]
BUFFER(4, writeonly, float, loss);           // [1]
BUFFER(5, readonly, float, dLoss);           // [1]
BUFFER(6, writeonly, Pair, dPredicted);  // [n], in pairs

const uint kEach = 4;  // pairs in the body of a loop

ENTRY(sums) {
    uint k = linearIndex(), count = (params.n + 1) / 2, stride = params.partials;
    if (k >= stride) return;
    vec2 both = vec2(0), either = vec2(0);
    for (uint first = k; first < count; first += kEach * stride) {
        [[unroll]] for (uint e = 0; e < kEach; ++e) {
            uint at = first + e * stride, i = min(at, count - 1);
            vec2 p = unpackPair(predicted.d[i]), g = unpackPair(target.d[i]);
            // Behind an odd number's last pixel there may be anything.
            bvec2 inside = bvec2(at < count, at < count && 2 * i + 1 < params.n);
            both += mix(vec2(0), p * g, inside);
            either += mix(vec2(0), p + g - p * g, inside);
        }
    }
    partial.d[k] = vec2(both.x + both.y, either.x + either.y);
}

ENTRY(finish) {
    SUM_PARTIALS(sum);
    if (localIndex() > 0) return;
    total.d[0] = sum;
    loss.d[0] = sum.y == 0 ? 0 : 1 - sum.x / sum.y;
}

ENTRY(backward) {
    vec2 sum = total.d[0];
    float scale = sum.y == 0 ? 0 : dLoss.d[0] / sum.y, ratio = sum.y == 0 ? 0 : sum.x / sum.y;
    uint n = params.n;
    EACH_PAIR(i, n) {
        vec2 g = unpackPair(target.d[i]);
        dPredicted.d[i] = packPair(scale * (ratio * (1 - g) - g));
    }
}
