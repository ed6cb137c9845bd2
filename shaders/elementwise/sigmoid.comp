// The logistic function of any shape [n], y = 1 / (1 + exp(-x));
// its gradient is dx = y (1 - y) dy.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 4)
BUFFER(0, readonly, vec2, x);    // [n], in pairs
BUFFER(1, readwrite, vec2, y);   // [n]
BUFFER(2, readonly, vec2, dy);   // [n]
BUFFER(3, writeonly, vec2, dx);  // [n]

ENTRY(forward) {
    EACH_PAIR(i, params.n) {
        vec2 v = x.d[i], e = exp(-abs(v));  // no overflow on either side
        y.d[i] = mix(vec2(1), e, lessThan(v, vec2(0))) / (1 + e);
    }
}

ENTRY(backward) {
    EACH_PAIR(i, params.n) {
        vec2 v = y.d[i], g = dy.d[i];
        dx.d[i] = v * (1 - v) * g;
    }
}
