// A rigid motion about a pivot, y = R (v - pivot) + pivot + trans, R = exp(rotation) by Rodrigues'
// formula (body/rotation.glsl): how vertices of the body's own frame come to camera space. With
// sums over the vertices dR = sum dy (v - pivot)^T and s = sum dy:
//     dv [V,3] = R^T dy,    drotation from dR,    dpivot = s - R^T s,    dtrans = s.
// Radians, metres.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/rows.glsl"
#include "body/params.h"
#include "body/rotation.glsl"
PARAMS(BodyParams, 13)
BUFFER(0, readonly, vec3, verts);      // [V,3]
BUFFER(1, readonly, vec3, rotation);   // [3] axis-angle
BUFFER(2, readonly, vec3, pivot);      // [3]
BUFFER(3, readonly, vec3, trans);      // [3]
BUFFER(4, writeonly, vec3, y);         // [V,3]
BUFFER(5, readonly, vec3, dy);         // [V,3]
BUFFER(6, writeonly, vec3, dverts);    // [V,3]
BUFFER(7, writeonly, vec3, partial);   // [chunks,4,3] columns of dR, sum of dy
BUFFER(8, readonly, vec3, sums);       // [4,3] the same over all chunks
BUFFER(9, writeonly, vec3, drotation); // [3]
BUFFER(10, writeonly, vec3, dpivot);   // [3]
BUFFER(11, writeonly, vec3, dtrans);   // [3]
LISTED_ROWS(12)

ENTRY(forward) {
    uint v = listedIndex();
    if (v >= params.vertices) return;
    vec3 p = pivot.d[0];
    y.d[v] = rotationOf(rotation.d[0]) * (verts.d[v] - p) + p + trans.d[0];
}

ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    dverts.d[v] = dy.d[v] * rotationOf(rotation.d[0]);
}

// One invocation per chunk of vertices.
ENTRY(backward_chunks) {
    uint chunk = linearIndex();
    if (chunk >= params.chunks) return;
    uint end = min(params.vertices, (chunk + 1) * kBodyChunk);
    vec3 p = pivot.d[0], sum = vec3(0);
    mat3 dR = mat3(0);
    for (uint v = chunk * kBodyChunk; v < end; ++v) {
        vec3 d = dy.d[v];
        dR += outerProduct(d, verts.d[v] - p);
        sum += d;
    }
    for (int column = 0; column < 3; ++column) partial.d[4 * chunk + column] = dR[column];
    partial.d[4 * chunk + 3] = sum;
}

// One invocation.
ENTRY(backward_motion) {
    if (linearIndex() > 0) return;
    vec3 w = rotation.d[0], sum = sums.d[3];
    drotation.d[0] = rotationGradient(w, mat3(sums.d[0], sums.d[1], sums.d[2]));
    dpivot.d[0] = sum - sum * rotationOf(w);
    dtrans.d[0] = sum;
}
