// Vertex normals n = s / max(|s|, epsilon), s = the sum over the faces at the vertex of the cross
// products (v1 - v0) x (v2 - v0) (m^2), so that larger faces count for more. Backward:
// ds = (dn - (n . dn) n) / |s|, which mesh/corner_gradient.comp takes to the vertices.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/rows.glsl"
#include "mesh/params.h"
PARAMS(MeshParams, 9)
BUFFER(0, readonly, vec3, verts);        // [V,3]
BUFFER(1, readonly, int, cornerBegin);   // [V+1]
BUFFER(2, readonly, ivec3, corners);     // [3F,3] face, next vertex, previous vertex
BUFFER(3, writeonly, vec3, normals);     // [V,3]
BUFFER(4, readwrite, float, scales);     // [V] 1 / max(length of the sum, epsilon)
BUFFER(5, readonly, vec3, y);            // [V,3] the normals again
BUFFER(6, readonly, vec3, dy);           // [V,3]
BUFFER(7, readwrite, vec3, dsums);       // [V,3] gradient of the unnormalised sum
LISTED_ROWS(8)

ENTRY(forward) {
    uint v = listedIndex();
    if (v >= params.n) return;
    vec3 p = verts.d[v], sum = vec3(0);
    int end = cornerBegin.d[v + 1];
    for (int i = cornerBegin.d[v]; i < end; ++i) {
        ivec3 corner = corners.d[i];
        sum += cross(verts.d[corner.y] - p, verts.d[corner.z] - p);
    }
    float scale = 1 / max(length(sum), kNormalEpsilon);
    scales.d[v] = scale;
    normals.d[v] = scale * sum;
}

ENTRY(backward_sum) {
    uint v = linearIndex();
    if (v >= params.n) return;
    vec3 n = y.d[v], d = dy.d[v];
    float scale = scales.d[v];
    // Below epsilon the sum is only scaled.
    if (scale < 1 / kNormalEpsilon) d -= dot(n, d) * n;
    dsums.d[v] = scale * d;
}
