// y = a b, element by element; its gradients are products as well, da = dy b and db = dy a. Any
// shape.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "elementwise/params.h"
PARAMS(ElementParams, 3)
BUFFER(0, readonly, vec2, a);   // [n], in pairs
BUFFER(1, readonly, vec2, b);   // [n]
BUFFER(2, writeonly, vec2, y);  // [n]

ENTRY(forward) {
    EACH_PAIR(i, params.n) y.d[i] = a.d[i] * b.d[i];
}
