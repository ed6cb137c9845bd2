// Uniform Laplacian, the mean over the vertices of |(mean of the neighbours) - v|, not squared:
// L_gl of Gomes et al., WACV 2022, section 3.1. With u_i the direction over the number of
// neighbours,
//     dv_i = dloss scale (sum over the neighbours j of u_j - (their number) u_i).
// Metres. A vertex without neighbours, or a length of 0, gives 0.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(MeshParams, 7)
BUFFER(0, readonly, vec3, verts);         // [V,3]
BUFFER(1, readonly, int, neighbourBegin); // [V+1]
BUFFER(2, readonly, int, neighbours);     // [2E]
BUFFER(3, writeonly, float, lengths);     // [V] scale * |(mean of the neighbours) - vertex|
BUFFER(4, readwrite, vec3, units);        // [V,3] the direction, over the number of neighbours
BUFFER(5, readonly, float, dloss);        // [1]
BUFFER(6, writeonly, vec3, dverts);       // [V,3]

ENTRY(forward) {
    uint v = linearIndex();
    if (v >= params.n) return;
    int begin = neighbourBegin.d[v], end = neighbourBegin.d[v + 1];
    vec3 p = verts.d[v], sum = vec3(0);
    for (int i = begin; i < end; ++i) sum += verts.d[neighbours.d[i]] - p;
    float total = length(sum);  // of degree times the difference
    float degree = max(float(end - begin), 1);
    lengths.d[v] = params.scale * total / degree;
    units.d[v] = total > 0 ? sum / (total * degree) : vec3(0);
}

ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.n) return;
    int begin = neighbourBegin.d[v], end = neighbourBegin.d[v + 1];
    vec3 sum = -float(end - begin) * units.d[v];
    for (int i = begin; i < end; ++i) sum += units.d[neighbours.d[i]];
    dverts.d[v] = params.scale * dloss.d[0] * sum;
}
