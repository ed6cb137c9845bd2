// AdamW (Loshchilov and Hutter, Decoupled Weight Decay Regularization, ICLR 2019, algorithm 2), in
// place, with g the gradient [n], r = rateScale learningRate and t the step:
//     m = b1 m + (1 - b1) g,    v = b2 v + (1 - b2) g^2,
//     x = (1 - r decay) x - r m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + epsilon).
// `all` updates whole arrays, `row` a table's row of this step's frame.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/step_params.h"
#include "optim/params.h"
PARAMS(AdamWParams, 9)
#include "common/blocks.glsl"
BUFFER(0, readwrite, float, value);         // [rows, n]
BUFFER(1, readonly, float, gradient);       // [n]
BUFFER(2, readwrite, float, moment1);       // [rows, n]
BUFFER(3, readwrite, float, moment2);       // [rows, n]
BUFFER(4, readonly, StepParams, step);      // [1]
BUFFER(5, readwrite, Block, values);        // [n], in pairs
BUFFER(6, readonly, Block, gradients);      // [n]
BUFFER(7, readwrite, Block, moments1);      // [n]
BUFFER(8, readwrite, Block, moments2);      // [n]

struct Step {
    float decay, rate, rootOfCorrection;
};
Step stepNow() {
    float rate = params.rateScale * step.d[0].learningRate;
    return Step(1 - rate * params.weightDecay, rate / step.d[0].beta1Correction,
                sqrt(step.d[0].beta2Correction));
}

void update(Step now, inout vec2 x, inout vec2 m, inout vec2 v, vec2 g) {
    m = params.beta1 * m + (1 - params.beta1) * g;
    v = params.beta2 * v + (1 - params.beta2) * g * g;
    x = now.decay * x - now.rate * m / (sqrt(v) / now.rootOfCorrection + params.epsilon);
}

ENTRY(all) {
    uint n = params.n;
    Step now = stepNow();
    EACH_PLACE(p, n) {
        p.pair += params.firstPair;
        vec2 x = PAIR(values, p), m = PAIR(moments1, p), v = PAIR(moments2, p);
        update(now, x, m, v, PAIR(gradients, p));
        BLOCK_PAIR(values, p) = packPair(x);
        BLOCK_PAIR(moments1, p) = packPair(m);
        BLOCK_PAIR(moments2, p) = packPair(v);
    }
}

// Only the row of this step's frame.
ENTRY(row) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint at = min(step.d[0].frame, params.rows - 1) * params.n + i;
    vec2 x = vec2(value.d[at]), m = vec2(moment1.d[at]), v = vec2(moment2.d[at]);
    update(stepNow(), x, m, v, vec2(gradient.d[i]));
    value.d[at] = x.x;
    moment1.d[at] = m.x;
    moment2.d[at] = v.x;
}
