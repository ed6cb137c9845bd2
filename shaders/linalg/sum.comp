// y[o, p, i] = the sum of x[o, c, i] over the stretch p of the middle axis, c in order; with
// kAccumulate added to what y holds. Stretches bound what one invocation adds up; a second dispatch
// adds up their sums.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "linalg/params.h"
PARAMS(SumParams, 2)
BUFFER(0, readonly, float, x);   // [outer, count, inner]
BUFFER(1, readwrite, float, y);  // [outer, parts, inner]

layout(constant_id = 1) const bool kAccumulate = false;

ENTRY(axis) {
    uint i = linearIndex();
    if (i >= params.outer * params.parts * params.inner) return;
    uint column = i % params.inner, part = i / params.inner % params.parts;
    uint first = part * params.partLength;
    uint last = min(params.count, first + params.partLength);
    uint at = ((i / params.inner / params.parts) * params.count + first) * params.inner + column;
    uint inner = params.inner;
    float total = 0;
    for (uint r = first; r < last; ++r) {
        total += x.d[at];
        at += inner;
    }
    y.d[i] = kAccumulate ? y.d[i] + total : total;
}
