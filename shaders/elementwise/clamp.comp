#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "elementwise/params.h"
PARAMS(ClampParams, 4)
BUFFER(0, readonly, uint64_t, x);    // [n], in pairs
BUFFER(1, writeonly, uint64_t, y);   // [n]
BUFFER(2, readonly, uint64_t, dy);   // [n]
BUFFER(3, writeonly, uint64_t, dx);  // [n]

ENTRY(forward) {
    uint n = params.n;
    EACH_PAIR(i, n) {
        vec2 v = unpackPair(x.d[i]);
        y.d[i] = packPair(clamp(v, params.low, params.high));
    }
}

ENTRY(backward) {
    uint n = params.n;
    EACH_PAIR(i, n) {
        vec2 v = unpackPair(x.d[i]), g = unpackPair(dy.d[i]);
        dx.d[i] = packPair(mix(g, vec2(0), notEqual(v, clamp(v, params.low, params.high))));
    }
}
