// Joints in rest pose, rest = regressor shaped: each a weighted mean of a few vertices, the
// regressor being kept as its numbers that are not zero, joint by joint (Loper and others, SMPL,
// ACM ToG 2015, equation 10). Metres. Its gradient is part of body/shape.comp.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "body/params.h"
PARAMS(BodyParams, 5)
BUFFER(0, readonly, float, regressor);   // [n]
BUFFER(1, readonly, int, jointBegin);    // [25]
BUFFER(2, readonly, int, jointVertices); // [n]
BUFFER(3, readonly, float, shaped);      // [V,3]
BUFFER(4, writeonly, float, rest);       // [24,3]

// One invocation per joint and coordinate.
ENTRY(forward) {
    uint i = linearIndex();
    if (i >= 24 * 3) return;
    uint joint = i / 3, coordinate = i % 3;
    int end = jointBegin.d[joint + 1];
    float sum = 0;
    for (int n = jointBegin.d[joint]; n < end; ++n)
        sum += regressor.d[n] * shaped.d[3 * jointVertices.d[n] + coordinate];
    rest.d[i] = sum;
}
