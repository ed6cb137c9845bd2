// loss = likely sum over joints of log(1 + |(theta_j - mean_j) precision_j|^2)
//        + limits sum of d^2, d being how far a component is outside of its limits
// over a pose's 24 rotation vectors, radians: Cauchy's loss, whose pull fades where a joint is surely
// elsewhere. Backward: to theta.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "fit/params.h"
PARAMS(PoseLikelihoodParams, 5)
BUFFER(0, readonly, float, theta);    // [72]
BUFFER(1, readonly, float, angles);   // [72,4]: mean, precision, low, high
BUFFER(2, writeonly, float, loss);    // [1]
BUFFER(3, readonly, float, dloss);    // [1]
BUFFER(4, writeonly, float, dtheta);  // [72]

const uint kJoints = 24;

// From the mean, in deviations.
float away(uint i) {
    return (theta.d[i] - angles.d[4 * i]) * angles.d[4 * i + 1];
}

// Beyond the limit, with its sign; 0 within.
float outside(uint i) {
    float t = theta.d[i];
    return max(t - angles.d[4 * i + 3], 0.0) + min(t - angles.d[4 * i + 2], 0.0);
}

float squaresOf(uint joint) {
    vec3 a = vec3(away(3 * joint), away(3 * joint + 1), away(3 * joint + 2));
    return dot(a, a);
}

// 24 joints: not worth a reduction tree.
ENTRY(forward) {
    if (linearIndex() > 0) return;
    float sum = 0;
    for (uint joint = 0; joint < kJoints; ++joint) {
        sum += params.likely * log(1 + squaresOf(joint));
        for (uint k = 0; k < 3; ++k) {
            float o = outside(3 * joint + k);
            sum += params.limits * o * o;
        }
    }
    loss.d[0] = sum;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= 3 * kJoints) return;
    float likely = away(i) * angles.d[4 * i + 1] / (1 + squaresOf(i / 3));
    dtheta.d[i] = 2 * dloss.d[0] * (params.likely * likely + params.limits * outside(i));
}
