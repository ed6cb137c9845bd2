// From the gradients of faces' cross products c = (b - a) x (d - a) = a x b + b x d + d x a to the
// vertices: da = (b - d) x dc, gathered along each vertex's corners in their order. from_vertices
// has them per vertex, for a face's cross product went into the sums of its three
// (mesh/normals.comp).
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(MeshParams, 6)
BUFFER(0, readonly, vec3, verts);       // [V,3]
BUFFER(1, readonly, int, cornerBegin);  // [V+1]
BUFFER(2, readonly, ivec3, corners);    // [3F,3] face, next vertex, previous vertex
BUFFER(3, readonly, vec3, dvertexSums); // [V,3] gradient of the sum of cross products at a vertex
BUFFER(4, readonly, vec3, dfaces);      // [F,3] gradient of a face's cross product
BUFFER(5, writeonly, vec3, dverts);     // [V,3]

ENTRY(from_vertices) {
    uint v = linearIndex();
    if (v >= params.n) return;
    vec3 own = dvertexSums.d[v], sum = vec3(0);
    int end = cornerBegin.d[v + 1];
    for (int i = cornerBegin.d[v]; i < end; ++i) {
        ivec3 corner = corners.d[i];
        sum += cross(verts.d[corner.y] - verts.d[corner.z],
                     own + dvertexSums.d[corner.y] + dvertexSums.d[corner.z]);
    }
    dverts.d[v] = sum;
}

ENTRY(from_faces) {
    uint v = linearIndex();
    if (v >= params.n) return;
    vec3 sum = vec3(0);
    int end = cornerBegin.d[v + 1];
    for (int i = cornerBegin.d[v]; i < end; ++i) {
        ivec3 corner = corners.d[i];
        sum += cross(verts.d[corner.y] - verts.d[corner.z], dfaces.d[corner.x]);
    }
    dverts.d[v] = sum;
}
