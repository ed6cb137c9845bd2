#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 5)
BUFFER(0, readwrite, uint64_t, total);  // [n], in pairs
BUFFER(1, readonly, uint64_t, more);    // [n]
BUFFER(2, readonly, uint64_t, a);       // [n]
BUFFER(3, readonly, uint64_t, b);       // [n]
BUFFER(4, writeonly, uint64_t, y);      // [n]

ENTRY(into) {
    uint n = params.n;
    EACH_PAIR(i, n)
        total.d[i] = packPair(unpackPair(total.d[i]) + unpackPair(more.d[i]));
}

ENTRY(forward) {
    uint n = params.n;
    EACH_PAIR(i, n)
        y.d[i] = packPair(unpackPair(a.d[i]) + unpackPair(b.d[i]));
}
