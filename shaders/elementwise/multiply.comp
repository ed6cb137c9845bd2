#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 3)
BUFFER(0, readonly, uint64_t, a);   // [n], in pairs
BUFFER(1, readonly, uint64_t, b);   // [n]
BUFFER(2, writeonly, uint64_t, y);  // [n]

// Its gradients are products as well: da = dy b, db = dy a.
ENTRY(forward) {
    uint n = params.n;
    EACH_PAIR(i, n)
        y.d[i] = packPair(unpackPair(a.d[i]) * unpackPair(b.d[i]));
}
