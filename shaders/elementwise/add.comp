// y = a + b, and total += more, by which gradients of several users of a tensor are accumulated
// (Graph::accumulateGradients). Any shape, n elements.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 5)
BUFFER(0, readwrite, vec2, total);  // [n], in pairs
BUFFER(1, readonly, vec2, more);    // [n]
BUFFER(2, readonly, vec2, a);       // [n]
BUFFER(3, readonly, vec2, b);       // [n]
BUFFER(4, writeonly, vec2, y);      // [n]

ENTRY(into) {
    EACH_PAIR(i, params.n) total.d[i] = total.d[i] + more.d[i];
}

ENTRY(forward) {
    EACH_PAIR(i, params.n) y.d[i] = a.d[i] + b.d[i];
}
