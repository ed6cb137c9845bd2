#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 4)
BUFFER(0, readonly, uint64_t, x);    // [n], in pairs
BUFFER(1, readwrite, uint64_t, y);   // [n]
BUFFER(2, readonly, uint64_t, dy);   // [n]
BUFFER(3, writeonly, uint64_t, dx);  // [n]

ENTRY(forward) {
    uint n = params.n;
    EACH_PAIR(i, n) {
        vec2 v = unpackPair(x.d[i]), e = exp(-abs(v));  // no overflow on either side
        y.d[i] = packPair(mix(vec2(1), e, lessThan(v, vec2(0))) / (1 + e));
    }
}

ENTRY(backward) {
    uint n = params.n;
    EACH_PAIR(i, n) {
        vec2 v = unpackPair(y.d[i]), g = unpackPair(dy.d[i]);
        dx.d[i] = packPair(v * (1 - v) * g);
    }
}
