// The joints of a posed body: with R_j = exp(theta_j) by Rodrigues' formula (body/rotation.glsl)
// and rest joints r_j, down the tree of parents p,
//     world_j = world_p [R_j | r_j - r_p],    transform_j = world_j [I | -r_j],
// and joint_j = the origin of world_j + trans. Loper and others, SMPL, ACM ToG 2015, equations 2 to
// 4; features are R_j - I, what pose blend shapes multiply (equation 9). Angles in radians, metres.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "body/params.h"
#include "body/rotation.glsl"
PARAMS(BodyParams, 8)
BUFFER(0, readonly, vec3, theta);       // [24,3] axis-angle
BUFFER(1, readonly, vec3, rest);        // [24,3] joints in rest pose
BUFFER(2, readonly, int, parents);      // [24] each less than its joint; the first has none
BUFFER(3, readonly, vec3, trans);       // [3]
BUFFER(4, readwrite, vec4, world);      // [24,3,4] joint frames: rotation and origin
BUFFER(5, writeonly, vec4, transforms); // [24,3,4] rest pose to posed, for skinning
BUFFER(6, writeonly, vec3, joints);     // [24,3]
BUFFER(7, writeonly, float, features);  // [23,3,3] R - I of all joints but the first

// One invocation: 24 joints down the tree are not worth sharing out.
ENTRY(forward) {
    if (linearIndex() > 0) return;
    vec3 shift = trans.d[0];
    for (int j = 0; j < 24; ++j) {
        mat3 R = rotationOf(theta.d[j]);
        vec3 origin = rest.d[j];
        if (j > 0) {
            for (int row = 0; row < 3; ++row)
                for (int column = 0; column < 3; ++column)
                    features.d[(j - 1) * 9 + row * 3 + column] =
                        R[column][row] - (row == column ? 1 : 0);
            int p = parents.d[j];
            mat3 parent = LOAD_ROTATION(world, p);
            origin = parent * (origin - rest.d[p]) + LOAD_ORIGIN(world, p);
            R = parent * R;
        }
        STORE_TRANSFORM(world, j, R, origin)
        vec3 offset = origin - R * rest.d[j];
        STORE_TRANSFORM(transforms, j, R, offset)
        joints.d[j] = origin + shift;
    }
}
