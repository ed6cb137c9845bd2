// y [n] = scale x where an element stays, 0 where it is dropped, scale = 1 / (1 - p) (Srivastava
// and others, Dropout, JMLR 2014). Which ones: those whose random 32 bits, a hash of (seed, step,
// stream, element), are below threshold = p 2^32. The gradient is the same map of dy.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/random.h"
#include "common/step_params.h"
#include "elementwise/params.h"
PARAMS(DropoutParams, 3)
BUFFER(0, readonly, vec2, x);           // [n], in pairs; backward: dy
BUFFER(1, writeonly, vec2, y);          // [n]; backward: dx
BUFFER(2, readonly, StepParams, step);  // [1]

ENTRY(forward) {
    uint seed = step.d[0].seed, now = step.d[0].step;
    EACH_PAIR(i, params.n) {
        uint element = params.first + 2 * i;
        uint first = randomBits(seed, now, params.stream, element);
        uint second = randomBits(seed, now, params.stream, element + 1);
        bvec2 stays = bvec2(first >= params.threshold, second >= params.threshold);
        y.d[i] = mix(vec2(0), params.scale * x.d[i], stays);
    }
}
