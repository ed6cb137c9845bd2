// Adam with one second moment for all rows (Nicolet, Jacobson, Jakob, Large Steps in Inverse
// Rendering of Geometry, ACM ToG 2021, section 4): rows keep their directions and relative lengths.
// With g the gradient [n,3], P its preconditioner (mesh/smooth_solve.comp) and t the step:
//     m = b1 m + (1 - b1) P g,    v = b2 v + (1 - b2) max over the rows of |P g|^2,
//     x -= r P m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + 1e-12).
// A maximum is the same in any order. v is the first number of its array.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/step_params.h"
#include "optim/params.h"
PARAMS(UniformAdamParams, 7)
BUFFER(0, readonly, vec3, gradient);    // [n,3] P g
BUFFER(1, readwrite, vec3, moment1);    // [n,3] m
BUFFER(2, readwrite, float, moment2);   // [1] v
BUFFER(3, readwrite, uint, largest);    // [1] bits of max |P g|^2
BUFFER(4, readonly, vec3, direction);   // [n,3] P m
BUFFER(5, readwrite, vec3, value);      // [n,3] x
BUFFER(6, readonly, StepParams, step);  // [1]

// A few invocations, each over many rows, so that few meet in the atomic.
ENTRY(moments) {
    uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x, most = 0;
    for (uint i = linearIndex(); i < params.rows; i += stride) {
        vec3 g = gradient.d[i];
        most = max(most, floatBitsToUint(dot(g, g)));
        moment1.d[i] = params.beta1 * moment1.d[i] + (1 - params.beta1) * g;
    }
    atomicMax(largest.d[0], most);
}

ENTRY(update) {
    if (linearIndex() > 0) return;
    moment2.d[0] =
        params.beta2 * moment2.d[0] + (1 - params.beta2) * uintBitsToFloat(largest.d[0]);
}

ENTRY(apply) {
    uint i = linearIndex();
    if (i >= params.rows) return;
    float root = sqrt(moment2.d[0] / step.d[0].beta2Correction) + 1e-12;
    float rate = params.rateScale * step.d[0].learningRate / step.d[0].beta1Correction;
    value.d[i] -= rate / root * direction.d[i];
}
