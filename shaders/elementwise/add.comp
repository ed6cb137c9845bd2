// y = a + b, and total += more, by which gradients of several users of a tensor are accumulated
// (Graph::accumulateGradients). Any shape, n elements.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 5)
#include "common/blocks.glsl"
BUFFER(0, readwrite, Block, total);  // [n], in pairs
BUFFER(1, readonly, Block, more);    // [n]
BUFFER(2, readonly, Block, a);       // [n]
BUFFER(3, readonly, Block, b);       // [n]
BUFFER(4, writeonly, Pair, y);      // [n]

ENTRY(into) {
    uint n = params.n;
    EACH_PLACE(p, n)
        BLOCK_PAIR(total, p) = packPair(PAIR(total, p) + PAIR(more, p));
}

ENTRY(forward) {
    uint n = params.n;
    EACH_PLACE(p, n)
        y.d[p.pair] = packPair(PAIR(a, p) + PAIR(b, p));
}
