// loss = sum c r^2 / (r^2 + scale^2) / sum c over joints [J,3]: the robust distance of Geman and
// McClure (Statistical Methods for Tomographic Image Reconstruction, 1987) of projected joints from
// keypoints, r in pixels, weighted with the keypoints' confidence c. With u = fx x / z + cx and v
// alike,
//     dr = dloss c / sum c 2 scale^2 / (r^2 + scale^2)^2 (u, v offset), taken back through the
//     camera.
// Joints in camera space (m). One workgroup: joints are few.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "loss/params.h"
#include "loss/reduce.glsl"
PARAMS(KeypointLossParams, 7)
BUFFER(0, readonly, float, joints);         // [J,3] camera space, m
BUFFER(1, readonly, float, targets);        // [J,3] u, v (pixels), confidence
BUFFER(2, readonly, RasterCamera, camera);  // [1]
BUFFER(3, readwrite, float, weight);        // [1] sum of confidences
BUFFER(4, writeonly, float, loss);          // [1]
BUFFER(5, readonly, float, dLoss);          // [1]
BUFFER(6, writeonly, float, djoints);       // [J,3]

vec3 jointAt(uint j) { return vec3(joints.d[3 * j], joints.d[3 * j + 1], joints.d[3 * j + 2]); }

// From the keypoint to the joint, in pixels; and the confidence, 0 where the joint is not in front.
vec3 offset(uint j) {
    RasterCamera c = camera.d[0];
    vec3 x = jointAt(j);
    if (!(x.z > kNear)) return vec3(0);
    vec2 at = vec2(c.fx * x.x / x.z + c.cx, c.fy * x.y / x.z + c.cy);
    vec3 target = vec3(targets.d[3 * j], targets.d[3 * j + 1], targets.d[3 * j + 2]);
    // A keypoint that was not found may be NaN with confidence 0.
    return target.z > 0 ? vec3(at - target.xy, target.z) : vec3(0);
}

ENTRY(forward) {
    vec2 mine = vec2(0);
    for (uint j = localIndex(); j < params.joints; j += gl_WorkGroupSize.x) {
        vec3 o = offset(j);
        float r2 = dot(o.xy, o.xy);
        mine += o.z * vec2(r2 / (r2 + params.scale * params.scale), 1);
    }
    vec2 sum = workgroupSum(mine);
    if (localIndex() > 0) return;
    weight.d[0] = sum.y;
    loss.d[0] = sum.y == 0 ? 0 : sum.x / sum.y;
}

ENTRY(backward) {
    uint j = linearIndex();
    if (j >= params.joints) return;
    vec3 o = offset(j), d = vec3(0);
    if (o.z > 0) {
        RasterCamera c = camera.d[0];
        vec3 x = jointAt(j);
        float scale2 = params.scale * params.scale, bottom = dot(o.xy, o.xy) + scale2;
        vec2 dOffset = dLoss.d[0] * o.z / weight.d[0] * 2 * scale2 / (bottom * bottom) * o.xy;
        d.xy = dOffset * vec2(c.fx, c.fy) / x.z;
        d.z = -dot(d.xy, x.xy) / x.z;
    }
    djoints.d[3 * j] = d.x;
    djoints.d[3 * j + 1] = d.y;
    djoints.d[3 * j + 2] = d.z;
}
