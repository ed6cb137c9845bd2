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
    y.d[i] = tanh(x.d[i]);
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    float t = y.d[i];
    dx.d[i] = (1 - t * t) * dy.d[i];
}
