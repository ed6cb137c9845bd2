#version 460
// AdamW (Loshchilov and Hutter, Decoupled Weight Decay Regularization, ICLR 2019), in place.
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/step_params.h"
#include "optim/params.h"
PARAMS(AdamWParams, 5)
BUFFER(0, readwrite, float, value);     // [n]; rows: [rows, n]
BUFFER(1, readonly, float, gradient);   // [n]
BUFFER(2, readwrite, float, moment1);   // as value
BUFFER(3, readwrite, float, moment2);   // as value
BUFFER(4, readonly, StepParams, step);  // [1]

void update(uint at, float g) {
    StepParams now = step.d[0];
    float rate = params.rateScale * now.learningRate;
    float m = params.beta1 * moment1.d[at] + (1 - params.beta1) * g;
    float v = params.beta2 * moment2.d[at] + (1 - params.beta2) * g * g;
    float root = sqrt(v) / sqrt(now.beta2Correction) + params.epsilon;
    float x = value.d[at] * (1 - rate * params.weightDecay);
    moment1.d[at] = m;
    moment2.d[at] = v;
    value.d[at] = x - rate / now.beta1Correction * m / root;
}

ENTRY(all) {
    uint i = linearIndex();
    if (i >= params.n) return;
    update(i, gradient.d[i]);
}

// Only the row of this step's frame.
ENTRY(row) {
    uint i = linearIndex();
    if (i >= params.n) return;
    update(min(step.d[0].frame, params.rows - 1) * params.n + i, gradient.d[i]);
}
