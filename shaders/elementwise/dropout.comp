#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
#include "common/random.h"
#include "common/step_params.h"
PARAMS(DropoutParams, 3)
BUFFER(0, readonly, float, x);          // [n]; backward: dy
BUFFER(1, writeonly, float, y);         // [n]; backward: dx
BUFFER(2, readonly, StepParams, step);  // [1]

// Its own gradient: the same elements are dropped, the others scaled.
ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint bits = randomBits(step.d[0].seed, step.d[0].step, params.stream, i);
    y.d[i] = bits < params.threshold ? 0 : params.scale * x.d[i];
}
