// y = x where x > 0, slope x elsewhere, slope >= 0 (0: ReLU); dx = dy or slope dy by the sign of y,
// which is that of x, so that x need not be kept. Any shape.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "elementwise/params.h"
PARAMS(LeakyReluParams, 4)
BUFFER(0, readonly, vec2, x);    // [n], in pairs
BUFFER(1, readwrite, vec2, y);   // [n]
BUFFER(2, readonly, vec2, dy);   // [n]
BUFFER(3, writeonly, vec2, dx);  // [n]

vec2 select(vec2 sign, vec2 v, float slope) {
    return mix(slope * v, v, greaterThan(sign, vec2(0)));
}

ENTRY(forward) {
    float slope = params.slope;
    EACH_PAIR(i, params.n) {
        vec2 v = x.d[i];
        y.d[i] = select(v, v, slope);
    }
}

ENTRY(backward) {
    float slope = params.slope;
    EACH_PAIR(i, params.n) dx.d[i] = select(y.d[i], dy.d[i], slope);
}
