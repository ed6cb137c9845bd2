// The hyperbolic tangent of any shape [n], y = tanh x;
// its gradient is dx = (1 - y^2) dy.
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
        vec2 v = x.d[i];
        // From 10 on it is one in floats, and some devices divide sinh by cosh, which become infinite.
        y.d[i] = tanh(clamp(v, -10.0, 10.0));
    }
}

ENTRY(backward) {
    EACH_PAIR(i, params.n) {
        vec2 v = y.d[i], g = dy.d[i];
        dx.d[i] = (1 - v * v) * g;
    }
}
