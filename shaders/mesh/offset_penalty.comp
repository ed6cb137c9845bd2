// What it costs a surface to leave its rest: with x the vertices' offsets and y_v = x_v - the mean of
// x over the neighbours and s_v a vertex's stiffness,
//     loss = scale sum_v (stay |x_v|^2 + smooth s_v |y_v|^2),
//     dx_v = 2 scale dloss (stay x_v + smooth (s_v y_v - sum over the neighbours j of
//            s_j y_j / degree_j)).
// x [V,3]. The offsets are smooth, not the surface: what the body's own shape has of creases stays.
// Metres; scale is one over the number of vertices. A vertex without neighbours has y = 0.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(OffsetPenaltyParams, 8)
BUFFER(0, readonly, vec3, offsets);        // [V,3]
BUFFER(1, readonly, int, neighbourBegin);  // [V+1]
BUFFER(2, readonly, int, neighbours);      // [2E]
BUFFER(3, writeonly, float, terms);        // [V]
BUFFER(4, readwrite, vec3, bends);         // [V,3] s y
BUFFER(5, readonly, float, dloss);         // [1]
BUFFER(6, writeonly, vec3, doffsets);      // [V,3]
BUFFER(7, readonly, float, stiffness);     // [V]

ENTRY(forward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    int begin = neighbourBegin.d[v], end = neighbourBegin.d[v + 1];
    vec3 x = offsets.d[v], sum = vec3(0);
    for (int i = begin; i < end; ++i) sum += offsets.d[neighbours.d[i]] - x;
    vec3 y = -sum / max(float(end - begin), 1);
    float stiff = stiffness.d[v];
    bends.d[v] = stiff * y;
    terms.d[v] = params.scale * (params.stay * dot(x, x) + params.smoothness * stiff * dot(y, y));
}

ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    int begin = neighbourBegin.d[v], end = neighbourBegin.d[v + 1];
    vec3 sum = bends.d[v];
    for (int i = begin; i < end; ++i) {
        int j = neighbours.d[i];
        sum -= bends.d[j] / float(neighbourBegin.d[j + 1] - neighbourBegin.d[j]);
    }
    vec3 d = params.stay * offsets.d[v] + params.smoothness * sum;
    doffsets.d[v] = 2 * params.scale * dloss.d[0] * d;
}
