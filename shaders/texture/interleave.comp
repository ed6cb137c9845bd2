#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "texture/params.h"
PARAMS(InterleaveParams, 2)
BUFFER(0, readonly, float, x);   // [C,H,W]; backward: dy [H,W,C]
BUFFER(1, writeonly, float, y);  // [H,W,C]; backward: dx [C,H,W]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.channels * params.pixels) return;
    y.d[i] = x.d[(i % params.channels) * params.pixels + i / params.channels];
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.channels * params.pixels) return;
    y.d[i] = x.d[(i % params.pixels) * params.channels + i / params.pixels];
}
