#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 3)
BUFFER(0, readonly, float, a);   // [n]
BUFFER(1, readonly, float, b);   // [n]
BUFFER(2, writeonly, float, y);  // [n]

// Its gradients are products as well: da = dy b, db = dy a.
ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    y.d[i] = a.d[i] * b.d[i];
}
