#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 4)
BUFFER(0, readonly, float, x);    // [n]
BUFFER(1, readwrite, float, y);   // [n]
BUFFER(2, readonly, float, dy);   // [n]
BUFFER(3, writeonly, float, dx);  // [n]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    float v = x.d[i], e = exp(-abs(v));  // no overflow on either side
    y.d[i] = (v < 0 ? e : 1) / (1 + e);
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    float s = y.d[i];
    dx.d[i] = s * (1 - s) * dy.d[i];
}
