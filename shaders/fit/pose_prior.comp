// loss = sum of stay_i c_i^2 + smoothness sum of (c_i - (before_i + after_i) / 2 + start_bend_i)^2
//        + shape sum of beta_k^2
// over a frame's correction c [75] (24 axis-angle rotations in radians, a translation): the pose
// stays near its start, stay being pose joint_weight for rotations and trans for the translation,
// it moves evenly (start_bend is the start's own way from the mean of its neighbours), and the shape
// is likely. Backward: to c and beta.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "fit/params.h"
PARAMS(PosePriorParams, 10)
BUFFER(0, readonly, float, correction);    // [75] of this frame
BUFFER(1, readonly, float, before);        // [75] of the frame before
BUFFER(2, readonly, float, after);         // [75] of the frame after
BUFFER(3, readonly, float, joint_weight);  // [24]
BUFFER(4, readonly, float, beta);          // [10]
BUFFER(5, writeonly, float, loss);         // [1]
BUFFER(6, readonly, float, dloss);         // [1]
BUFFER(7, writeonly, float, dcorrection);  // [75]
BUFFER(8, writeonly, float, dbeta);        // [10]
BUFFER(9, readonly, float, start_bend);    // [75]

// How dear it is to move element i of a pose row away from where it started.
float stay(uint i) {
    return i < 72 ? params.pose * joint_weight.d[i / 3] : params.trans;
}

// How far it is from what the neighbouring frames suggest.
float bend(uint i) {
    return correction.d[i] - 0.5 * (before.d[i] + after.d[i]) + start_bend.d[i];
}

// 85 terms: not worth a reduction tree.
ENTRY(forward) {
    if (linearIndex() > 0) return;
    float sum = 0;
    for (uint i = 0; i < POSE_ROW_LENGTH; ++i) {
        float c = correction.d[i], b = bend(i);
        sum += stay(i) * c * c + params.smoothness * b * b;
    }
    for (uint i = 0; i < 10; ++i) sum += params.shape * beta.d[i] * beta.d[i];
    loss.d[0] = sum;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i < POSE_ROW_LENGTH)
        dcorrection.d[i] =
            2 * dloss.d[0] * (stay(i) * correction.d[i] + params.smoothness * bend(i));
    if (i < 10) dbeta.d[i] = 2 * dloss.d[0] * params.shape * beta.d[i];
}
