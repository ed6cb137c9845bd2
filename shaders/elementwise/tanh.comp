// The hyperbolic tangent of any shape [n], y = tanh x;
// its gradient is dx = (1 - y^2) dy.
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
        vec2 v = PAIR(x, p);
        // From 10 on it is one in floats, and some devices divide sinh by cosh, which become infinite.
        BLOCK_PAIR(y, p) = packPair(tanh(clamp(v, -10.0, 10.0)));
    }
}

ENTRY(backward) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(y, p), g = PAIR(dy, p);
        dx.d[p.pair] = packPair((1 - v * v) * g);
    }
}
