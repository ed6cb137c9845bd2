// y[o, p, i] = the sum of x[o, c, i] over the stretch p of the middle axis, c in order; with
// kAccumulate added to what y holds. Stretches bound what one invocation adds up; a second dispatch
// adds up their sums.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "linalg/params.h"
PARAMS(SumParams, 3)
BUFFER(0, readonly, float, x);   // [outer, count, inner]
BUFFER(1, readwrite, float, y);  // [outer, parts, inner]
QUADS(2, xQuads);               // x again

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

// Four columns per invocation, for an inner axis of a multiple of 4; zeros are read behind the end.
CPU_ENTRY(axis_quads) {
    uint i = linearIndex(), row = params.inner / 4;
    if (i >= params.outer * params.parts * row) return;
    uint column = i % row, part = i / row % params.parts;
    uint first = part * params.partLength;
    uint last = min(params.count, first + params.partLength);
    uint at = ((i / row / params.parts) * params.count + first) * row + column;
    const uint kRows = 4;  // in the loop's body
    vec4 total = vec4(0);
    for (uint r = first; r < last; r += kRows) {
        [[unroll]] for (uint u = 0; u < kRows; ++u) {
            vec4 v = quadAt(xQuads, at + u * row);
            if (r + u < last) total += v;
        }
        at += kRows * row;
    }
    [[unroll]] for (uint k = 0; k < 4; ++k)
        y.d[4 * i + k] = kAccumulate ? y.d[4 * i + k] + total[k] : total[k];
}
