// What it costs faces to shrink or to turn over: with c the cross product of a face's edges, c0 that of
// the same face of a reference surface, and s_f = (c . c0) / |c0|^2, which is 1 for the reference, 0 for a
// face without an area or one at right angles to it, and less for one that is turned over,
//     loss = sum_f w_f max(0, least - s_f)^2,    dc_f = -2 dloss w_f max(0, least - s_f) c0_f / |c0_f|^2;
// mesh/corner_gradient.comp takes dc to the vertices. A quadratic wall stands here in place of the
// barriers of Garanzha et al., Foldover-free maps in 50 lines of code, ACM ToG 2021, for a surface may
// begin with faces beyond it. verts, reference [V,3], metres. Faces whose reference has no area count
// nothing.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(FoldPenaltyParams, 8)
BUFFER(0, readonly, vec3, verts);       // [V,3]
BUFFER(1, readonly, vec3, reference);   // [V,3]
BUFFER(2, readonly, ivec3, faces);      // [F,3]
BUFFER(3, readonly, float, weight);     // [F] w
BUFFER(4, writeonly, float, terms);     // [F]
BUFFER(5, readwrite, vec4, walls);      // [F,4] c0 / |c0|^2; w max(0, least - s)
BUFFER(6, readonly, float, dloss);      // [1]
BUFFER(7, writeonly, vec3, dfaces);     // [F,3] gradient of the cross product

ENTRY(forward) {
    uint f = linearIndex();
    if (f >= params.faces) return;
    ivec3 face = faces.d[f];
    vec3 a = verts.d[face.x], a0 = reference.d[face.x];
    vec3 c = cross(verts.d[face.y] - a, verts.d[face.z] - a);
    vec3 c0 = cross(reference.d[face.y] - a0, reference.d[face.z] - a0);
    float square = dot(c0, c0);
    vec3 per = square > 1e-24 ? c0 / square : vec3(0);  // an area of a square micrometre
    float wall = square > 1e-24 ? max(0, params.least - dot(c, per)) : 0;
    float weighed = weight.d[f] * wall;
    walls.d[f] = vec4(per, weighed);
    terms.d[f] = weighed * wall;
}

ENTRY(backward) {
    uint f = linearIndex();
    if (f >= params.faces) return;
    vec4 wall = walls.d[f];
    dfaces.d[f] = -2 * dloss.d[0] * wall.w * wall.xyz;
}
