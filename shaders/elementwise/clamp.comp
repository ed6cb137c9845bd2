#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ClampParams, 4)
BUFFER(0, readonly, float, x);    // [n]
BUFFER(1, writeonly, float, y);   // [n]
BUFFER(2, readonly, float, dy);   // [n]
BUFFER(3, writeonly, float, dx);  // [n]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    y.d[i] = clamp(x.d[i], params.low, params.high);
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    float v = x.d[i];
    dx.d[i] = v < params.low || v > params.high ? 0 : dy.d[i];
}
