// Linear blend skinning, v = (sum over k of w_k T_j(k)) [posed; 1] + trans with K influences w_k of
// joints j(k) per vertex, T_j their 3x4 transforms from body/pose.comp (Loper and others, SMPL, ACM
// ToG 2015, equation 7). Backward: dposed = (sum of w_k R_j)^T dv, dT_j = sum of w_k dv [posed;
// 1]^T, by chunks of a joint's entries and then over each joint's chunks. Metres.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/rows.glsl"
#include "body/params.h"
#include "body/rotation.glsl"
PARAMS(BodyParams, 13)
BUFFER(0, readonly, vec3, posed);          // [V,3] in rest pose, all blend shapes added
BUFFER(1, readonly, float, weights);       // [V,K]
BUFFER(2, readonly, int, weightJoints);    // [V,K] whose they are
BUFFER(3, readonly, vec4, transforms);     // [24,3,4]
BUFFER(4, readonly, vec3, trans);          // [3]
BUFFER(5, writeonly, vec3, verts);         // [V,3]
BUFFER(6, readonly, vec3, dverts);         // [V,3]
BUFFER(7, writeonly, vec3, dposed);        // [V,3]
BUFFER(8, readonly, int, entries);         // [n] places in weights, joint after joint
BUFFER(9, readonly, int, chunkBegin);      // [chunks+1] each chunk has one joint's entries
BUFFER(10, readwrite, vec4, partial);      // [chunks,3,4] of dtransforms
BUFFER(11, readonly, int, jointChunks);    // [25] each joint's chunks
BUFFER(12, writeonly, vec4, dtransforms);  // [24,3,4]
LISTED_ROWS(6)  // there is no place left but one that forward does not use

ENTRY(forward) {
    uint v = listedIndex();
    if (v >= params.vertices) return;
    vec4 rows[3] = {vec4(0), vec4(0), vec4(0)};
    uint first = v * params.influences;
    for (uint k = first; k < first + params.influences; ++k) {
        float weight = weights.d[k];
        uint j = 3 * weightJoints.d[k];
        [[unroll]] for (int row = 0; row < 3; ++row)
            rows[row] += weight * transforms.d[j + row];
    }
    vec4 p = vec4(posed.d[v], 1);
    verts.d[v] = vec3(dot(rows[0], p), dot(rows[1], p), dot(rows[2], p)) + trans.d[0];
}

ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    vec3 d = dverts.d[v], sum = vec3(0);
    uint first = v * params.influences;
    for (uint k = first; k < first + params.influences; ++k) {
        uint j = 3 * weightJoints.d[k];
        vec3 turned = d.x * transforms.d[j].xyz + d.y * transforms.d[j + 1].xyz +
                      d.z * transforms.d[j + 2].xyz;
        sum += weights.d[k] * turned;
    }
    dposed.d[v] = sum;
}

// dtransforms by chunks ...
ENTRY(backward_chunks) {
    uint chunk = linearIndex();
    if (chunk >= params.chunks) return;
    vec4 rows[3] = {vec4(0), vec4(0), vec4(0)};
    int end = chunkBegin.d[chunk + 1];
    for (int i = chunkBegin.d[chunk]; i < end; ++i) {
        uint entry = entries.d[i];
        uint v = entry / params.influences;
        vec4 p = weights.d[entry] * vec4(posed.d[v], 1);
        vec3 d = dverts.d[v];
        for (int row = 0; row < 3; ++row) rows[row] += d[row] * p;
    }
    for (int row = 0; row < 3; ++row) partial.d[3 * chunk + row] = rows[row];
}

// ... and then over each joint's chunks. One invocation per row of a transform.
ENTRY(backward_joints) {
    uint i = linearIndex();
    if (i >= 24 * 3) return;
    uint joint = i / 3, row = i % 3;
    int end = jointChunks.d[joint + 1];
    vec4 sum = vec4(0);
    for (int chunk = jointChunks.d[joint]; chunk < end; ++chunk) sum += partial.d[3 * chunk + row];
    dtransforms.d[i] = sum;
}
