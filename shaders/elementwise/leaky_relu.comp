// y = x where x > 0, slope x elsewhere, slope >= 0 (0: ReLU); dx = dy or slope dy by the sign of y,
// which is that of x, so that x need not be kept. Any shape.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(LeakyReluParams, 4)
#include "common/blocks.glsl"
BUFFER(0, readonly, Block, x);    // [n], in pairs
BUFFER(1, readwrite, Block, y);   // [n]
BUFFER(2, readonly, Block, dy);   // [n]
BUFFER(3, writeonly, Pair, dx);  // [n]

vec2 select(vec2 sign, vec2 v, float slope) {
    return mix(slope * v, v, greaterThan(sign, vec2(0)));
}

ENTRY(forward) {
    uint n = params.n;
    float slope = params.slope;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(x, p);
        BLOCK_PAIR(y, p) = packPair(select(v, v, slope));
    }
}

ENTRY(backward) {
    uint n = params.n;
    float slope = params.slope;
    EACH_PLACE(p, n)
        dx.d[p.pair] = packPair(select(PAIR(y, p), PAIR(dy, p), slope));
}
