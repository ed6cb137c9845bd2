#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(AddParams, 5)
BUFFER(0, readwrite, float, total);  // [n]
BUFFER(1, readonly, float, more);    // [n]
BUFFER(2, readonly, float, a);       // [n]
BUFFER(3, readonly, float, b);       // [n]
BUFFER(4, writeonly, float, y);      // [n]

ENTRY(into) {
    uint i = linearIndex();
    if (i >= params.n) return;
    total.d[i] += more.d[i];
}

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    y.d[i] = a.d[i] + b.d[i];
}
