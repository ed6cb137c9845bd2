// Shape blend shapes, shaped [V,3] = templateVerts + shapeDirections beta (Loper and others, SMPL,
// ACM ToG 2015, equation 8). Backward: a vertex moves the skin directly, and through the joints
// that regressor makes of it: dshaped = dposed + regressor^T drest, dbeta = shapeDirections^T
// dshaped, summed over chunks of vertices, which linalg/sum.comp adds up. Metres; beta in standard
// deviations.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "body/params.h"
PARAMS(BodyParams, 12)
BUFFER(0, readonly, vec3, templateVerts);     // [V,3]
BUFFER(1, readonly, float, shapeDirections);  // [V,3,10]
BUFFER(2, readonly, vec2, betaPairs);         // [10], two at a time
BUFFER(3, writeonly, vec3, shaped);           // [V,3] forward's result
BUFFER(4, readonly, vec3, dposed);            // [V,3] before pose blend shapes have been added
BUFFER(5, readonly, float, regressor);        // [n] the numbers of the regressor that are there
BUFFER(6, readonly, int, vertexBegin);        // [V+1]
BUFFER(7, readonly, ivec2, vertexEntries);    // [n,2] by vertex: joint, place in regressor
BUFFER(8, readonly, vec3, drest);             // [24,3] of the joints in rest pose
BUFFER(9, readwrite, vec3, dshaped);          // [V,3] = dtemplate
BUFFER(10, writeonly, float, partial);        // [chunks,10] of dbeta
BUFFER(11, readonly, vec2, directionPairs);   // shapeDirections, likewise
const int kShapes = 10;

ENTRY(forward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    vec3 sum = templateVerts.d[v];
    uint row = v * 3 * kShapes / 2;
    [[unroll]] for (int k = 0; k < kShapes / 2; ++k) {
        vec2 b = betaPairs.d[k], x = directionPairs.d[row + k];
        vec2 y = directionPairs.d[row + kShapes / 2 + k];
        vec2 z = directionPairs.d[row + kShapes + k];
        sum += b.x * vec3(x.x, y.x, z.x);
        sum += b.y * vec3(x.y, y.y, z.y);
    }
    shaped.d[v] = sum;
}

ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    vec3 sum = dposed.d[v];
    int end = vertexBegin.d[v + 1];
    for (int i = vertexBegin.d[v]; i < end; ++i) {
        ivec2 entry = vertexEntries.d[i];
        sum += regressor.d[entry.y] * drest.d[entry.x];
    }
    dshaped.d[v] = sum;
}

// One invocation per chunk of vertices.
ENTRY(backward_beta) {
    uint chunk = linearIndex();
    if (chunk >= params.chunks) return;
    uint end = min(params.vertices, (chunk + 1) * kBodyChunk);
    float sum[kShapes];
    for (int k = 0; k < kShapes; ++k) sum[k] = 0;
    for (uint v = chunk * kBodyChunk; v < end; ++v) {
        vec3 d = dshaped.d[v];
        uint row = v * 3 * kShapes;
        for (int k = 0; k < kShapes; ++k)
            sum[k] += d.x * shapeDirections.d[row + k] +
                      d.y * shapeDirections.d[row + kShapes + k] +
                      d.z * shapeDirections.d[row + 2 * kShapes + k];
    }
    for (int k = 0; k < kShapes; ++k) partial.d[chunk * kShapes + k] = sum[k];
}
