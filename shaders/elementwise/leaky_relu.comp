#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(LeakyReluParams, 4)
BUFFER(0, readonly, float, x);    // [n]
BUFFER(1, readwrite, float, y);   // [n]
BUFFER(2, readonly, float, dy);   // [n]
BUFFER(3, writeonly, float, dx);  // [n]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    float v = x.d[i];
    y.d[i] = v > 0 ? v : params.slope * v;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    dx.d[i] = y.d[i] > 0 ? dy.d[i] : params.slope * dy.d[i];
}
