// loss = log(1 + |r|^2 / deviation^2) + level (a^2 + b^2), r = q - (q . g) g: how far a body's centre
// of mass is beside what it stands on, q = sum of share_j p_j being the way between them and
// g = v / |v|, v = (a, -1, b), what is up. Backward, with w = 2 / (deviation^2 + |r|^2):
//     dp_j = w share_j r,   dv = -w (q . g) / |v| r
// Joints in camera space (m), y down.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "fit/params.h"
PARAMS(BalanceParams, 7)
BUFFER(0, readonly, float, joints);    // [J,3]
BUFFER(1, readonly, float, shares);    // [J]
BUFFER(2, readonly, float, up);        // [2] a, b
BUFFER(3, writeonly, float, loss);     // [1]
BUFFER(4, readonly, float, dloss);     // [1]
BUFFER(5, writeonly, float, djoints);  // [J,3]
BUFFER(6, writeonly, float, dup);      // [2]

// Joints are few: every invocation sums them.
vec3 way() {
    vec3 q = vec3(0);
    for (uint j = 0; j < params.joints; ++j)
        q += shares.d[j] * vec3(joints.d[3 * j], joints.d[3 * j + 1], joints.d[3 * j + 2]);
    return q;
}

ENTRY(forward) {
    if (linearIndex() > 0) return;
    vec2 slopes = vec2(up.d[0], up.d[1]);
    vec3 q = way(), g = normalize(vec3(slopes.x, -1, slopes.y));
    vec3 r = q - dot(q, g) * g;
    loss.d[0] = log(1 + dot(r, r) / (params.deviation * params.deviation)) +
                params.level * dot(slopes, slopes);
}

ENTRY(backward) {
    uint j = linearIndex();
    if (j >= params.joints) return;
    vec3 v = vec3(up.d[0], -1, up.d[1]), q = way(), g = normalize(v);
    vec3 r = q - dot(q, g) * g;
    float w = 2 * dloss.d[0] / (params.deviation * params.deviation + dot(r, r));
    vec3 d = w * shares.d[j] * r;
    djoints.d[3 * j] = d.x;
    djoints.d[3 * j + 1] = d.y;
    djoints.d[3 * j + 2] = d.z;
    if (j > 0) return;
    vec3 dv = -w * dot(q, g) / length(v) * r;
    dup.d[0] = dv.x + 2 * dloss.d[0] * params.level * v.x;
    dup.d[1] = dv.z + 2 * dloss.d[0] * params.level * v.z;
}
