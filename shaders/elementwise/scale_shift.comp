// An affine map of any shape [n], y = scale x + shift;
// its gradient is dx = scale dy.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "elementwise/params.h"
PARAMS(ScaleShiftParams, 4)
BUFFER(0, readonly, vec2, x);    // [n], in pairs
BUFFER(1, writeonly, vec2, y);   // [n]
BUFFER(2, readonly, vec2, dy);   // [n]
BUFFER(3, writeonly, vec2, dx);  // [n]

ENTRY(forward) {
    EACH_PAIR(i, params.n) {
        vec2 v = x.d[i];
        y.d[i] = params.scale * v + params.shift;
    }
}

ENTRY(backward) {
    EACH_PAIR(i, params.n) {
        vec2 g = dy.d[i];
        dx.d[i] = params.scale * g;
    }
}
