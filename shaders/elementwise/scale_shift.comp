// An affine map of any shape [n], y = scale x + shift;
// its gradient is dx = scale dy.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ScaleShiftParams, 4)
#include "common/blocks.glsl"
BUFFER(0, readonly, Block, x);    // [n], in pairs
BUFFER(1, writeonly, Pair, y);   // [n]
BUFFER(2, readonly, Block, dy);   // [n]
BUFFER(3, writeonly, Pair, dx);  // [n]

ENTRY(forward) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(x, p);
        y.d[p.pair] = packPair(params.scale * v + params.shift);
    }
}

ENTRY(backward) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 g = PAIR(dy, p);
        dx.d[p.pair] = packPair(params.scale * g);
    }
}
