// The logistic function of any shape [n], y = 1 / (1 + exp(-x));
// its gradient is dx = y (1 - y) dy.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 4)
#include "common/blocks.glsl"
BUFFER(0, readonly, Block, x);    // [n], in pairs
BUFFER(1, readwrite, Block, y);   // [n]
BUFFER(2, readonly, Block, dy);   // [n]
BUFFER(3, writeonly, Pair, dx);  // [n]

ENTRY(forward) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(x, p), e = exp(-abs(v));  // no overflow on either side
        BLOCK_PAIR(y, p) = packPair(mix(vec2(1), e, lessThan(v, vec2(0))) / (1 + e));
    }
}

ENTRY(backward) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(y, p), g = PAIR(dy, p);
        dx.d[p.pair] = packPair(v * (1 - v) * g);
    }
}
