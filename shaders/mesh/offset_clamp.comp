// y = verts + clamp(offset, -limit, limit), component by component: offsets bounded per body part,
// K(v) of Gomes et al., WACV 2022, section 3.1. Metres. doffset = dy where |offset| < limit, else
// 0.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/rows.glsl"
#include "mesh/params.h"
PARAMS(MeshParams, 7)
BUFFER(0, readonly, vec3, verts);     // [V,3]
BUFFER(1, readonly, vec3, offset);    // [V,3]
BUFFER(2, readonly, float, limit);    // [V] 0 or more
BUFFER(3, writeonly, vec3, y);        // [V,3]
BUFFER(4, readonly, vec3, dy);        // [V,3]
BUFFER(5, writeonly, vec3, doffset);  // [V,3]
LISTED_ROWS(6)

ENTRY(forward) {
    uint v = listedIndex();
    if (v >= params.n) return;
    float bound = limit.d[v];
    y.d[v] = verts.d[v] + clamp(offset.d[v], -bound, bound);
}

// Nothing flows where the bound holds the offset, and a bound of 0 always does.
ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.n) return;
    vec3 d = dy.d[v];
    bvec3 isFree = lessThan(abs(offset.d[v]), vec3(limit.d[v]));
    doffset.d[v] = mix(vec3(0), d, isFree);
}
