#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "elementwise/params.h"
PARAMS(LeakyReluParams, 4)
BUFFER(0, readonly, uint64_t, x);    // [n], in pairs
BUFFER(1, readwrite, uint64_t, y);   // [n]
BUFFER(2, readonly, uint64_t, dy);   // [n]
BUFFER(3, writeonly, uint64_t, dx);  // [n]

vec2 select(vec2 sign, vec2 v, float slope) {
    return mix(slope * v, v, greaterThan(sign, vec2(0)));
}

ENTRY(forward) {
    uint n = params.n;
    float slope = params.slope;
    EACH_PAIR(i, n) {
        vec2 v = unpackPair(x.d[i]);
        y.d[i] = packPair(select(v, v, slope));
    }
}

// The sign of y is that of x.
ENTRY(backward) {
    uint n = params.n;
    float slope = params.slope;
    EACH_PAIR(i, n)
        dx.d[i] = packPair(select(unpackPair(y.d[i]), unpackPair(dy.d[i]), slope));
}
