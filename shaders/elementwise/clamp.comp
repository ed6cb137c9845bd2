// Bounds what it is given, y = min(max(x, low), high), of any shape [n];
// dx = dy where x is within [low, high], 0 elsewhere.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "elementwise/params.h"
PARAMS(ClampParams, 4)
BUFFER(0, readonly, vec2, x);    // [n], in pairs
BUFFER(1, writeonly, vec2, y);   // [n]
BUFFER(2, readonly, vec2, dy);   // [n]
BUFFER(3, writeonly, vec2, dx);  // [n]

ENTRY(forward) {
    EACH_PAIR(i, params.n) {
        vec2 v = x.d[i];
        y.d[i] = clamp(v, params.low, params.high);
    }
}

ENTRY(backward) {
    EACH_PAIR(i, params.n) {
        vec2 v = x.d[i], g = dy.d[i];
        dx.d[i] = mix(g, vec2(0), notEqual(v, clamp(v, params.low, params.high)));
    }
}
