// Normal consistency, the mean over the pairs of faces that share an edge of 1 - cos(n0, n1), the
// pair being wound consistently: L_gn of Gomes et al., WACV 2022, section 3.1. Each face sums half
// of its pairs' terms. With unit normal n and cross product c of a face, |c| its length,
//     dc = -dloss scale (s - (s . n) n) / |c|,    s = the sum of the other faces' normals;
// mesh/corner_gradient.comp takes dc to the vertices. Faces without an area: 1, no gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(MeshParams, 8)
BUFFER(0, readonly, vec3, verts);      // [V,3]
BUFFER(1, readonly, ivec3, faces);     // [F,3]
BUFFER(2, readwrite, vec4, units);     // [F,4] unit normal; 1 / length of the cross product, or 0
BUFFER(3, readonly, int, pairBegin);   // [F+1]
BUFFER(4, readonly, int, pairFaces);   // [2P] 2 * other face + (1 where wound the other way)
BUFFER(5, writeonly, float, terms);    // [F] scale * the face's half of its pairs' terms
BUFFER(6, readonly, float, dloss);     // [1]
BUFFER(7, writeonly, vec3, dfaces);    // [F,3] gradient of the cross product

ENTRY(normals) {
    uint f = linearIndex();
    if (f >= params.n) return;
    ivec3 face = faces.d[f];
    vec3 a = verts.d[face.x];
    vec3 n = cross(verts.d[face.y] - a, verts.d[face.z] - a);
    float size = length(n);
    float inverse = size > 1e-18 ? 1 / size : 0;  // smaller ones have no digits left in n
    units.d[f] = vec4(inverse * n, inverse);
}

// 1 - cos of the angle to every face across an edge; 1 where one of the two has no area.
ENTRY(forward) {
    uint f = linearIndex();
    if (f >= params.n) return;
    vec3 n = units.d[f].xyz;
    float sum = 0;
    int end = pairBegin.d[f + 1];
    for (int i = pairBegin.d[f]; i < end; ++i) {
        int pair = pairFaces.d[i];
        float cosine = dot(n, units.d[pair >> 1].xyz);
        sum += 1 - ((pair & 1) == 0 ? cosine : -cosine);
    }
    terms.d[f] = 0.5 * params.scale * sum;
}

ENTRY(backward) {
    uint f = linearIndex();
    if (f >= params.n) return;
    vec4 unit = units.d[f];
    vec3 sum = vec3(0);
    int end = pairBegin.d[f + 1];
    for (int i = pairBegin.d[f]; i < end; ++i) {
        int pair = pairFaces.d[i];
        vec3 other = units.d[pair >> 1].xyz;
        sum += (pair & 1) == 0 ? other : -other;
    }
    sum -= dot(sum, unit.xyz) * unit.xyz;
    dfaces.d[f] = -params.scale * dloss.d[0] * unit.w * sum;
}
