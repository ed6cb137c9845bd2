// Pose blend shapes, posed = shaped + poseDirections features with features = R - I of 23 joints
// (Loper and others, SMPL, ACM ToG 2015, equation 9); backward sums dfeatures = poseDirections^T
// dposed over a chunk of vertices, which linalg/sum.comp adds up. Metres.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "body/params.h"
PARAMS(BodyParams, 6)
BUFFER(0, readonly, float, poseDirections);  // [V,3,207]
BUFFER(1, readonly, float, features);        // [207]
BUFFER(2, readonly, float, shaped);          // [V,3]
BUFFER(3, writeonly, float, posed);          // [V,3] forward's result
BUFFER(4, readonly, float, dposed);          // [V,3]
BUFFER(5, writeonly, float, partial);        // [chunks,207] of dfeatures
const int kFeatures = 207;

// One invocation per coordinate.
ENTRY(forward) {
    uint i = linearIndex();
    if (i >= 3 * params.vertices) return;
    float sum = 0;
    for (int k = 0; k < kFeatures; ++k)
        sum += poseDirections.d[i * kFeatures + k] * features.d[k];
    posed.d[i] = shaped.d[i] + sum;
}

// One invocation per chunk of vertices and feature.
ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.chunks * kFeatures) return;
    uint chunk = i / kFeatures, k = i % kFeatures;
    uint end = 3 * min(params.vertices, (chunk + 1) * kBodyChunk);
    float sum = 0;
    for (uint n = 3 * chunk * kBodyChunk; n < end; ++n)
        sum += poseDirections.d[n * kFeatures + k] * dposed.d[n];
    partial.d[i] = sum;
}
