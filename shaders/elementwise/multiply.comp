// y = a b, element by element; its gradients are products as well, da = dy b and db = dy a. Any
// shape.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 3)
#include "common/blocks.glsl"
BUFFER(0, readonly, Block, a);   // [n], in pairs
BUFFER(1, readonly, Block, b);   // [n]
BUFFER(2, writeonly, Pair, y);  // [n]

ENTRY(forward) {
    uint n = params.n;
    EACH_PLACE(p, n)
        y.d[p.pair] = packPair(PAIR(a, p) * PAIR(b, p));
}
