// Bounds what it is given, y = min(max(x, low), high), of any shape [n];
// dx = dy where x is within [low, high], 0 elsewhere.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ClampParams, 4)
#include "common/blocks.glsl"
BUFFER(0, readonly, Block, x);    // [n], in pairs
BUFFER(1, writeonly, Pair, y);   // [n]
BUFFER(2, readonly, Block, dy);   // [n]
BUFFER(3, writeonly, Pair, dx);  // [n]

ENTRY(forward) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(x, p);
        y.d[p.pair] = packPair(clamp(v, params.low, params.high));
    }
}

ENTRY(backward) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(x, p), g = PAIR(dy, p);
        dx.d[p.pair] = packPair(mix(g, vec2(0), notEqual(v, clamp(v, params.low, params.high))));
    }
}
