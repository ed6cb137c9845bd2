#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(AddParams, 2)
BUFFER(0, readwrite, float, total);  // [n]
BUFFER(1, readonly, float, more);    // [n]

ENTRY(into) {
    uint i = linearIndex();
    if (i >= params.n) return;
    total.d[i] += more.d[i];
}
