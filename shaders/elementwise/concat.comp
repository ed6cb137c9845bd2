// Copies a part [outer, inner] to its columns of y [outer, innerAll], from column `start` on, or
// the gradient of these back; with kRelu y = max(0, part), whose gradient is 0 where y is.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "elementwise/params.h"
PARAMS(ConcatParams, 8)
BUFFER(0, readonly, float, part);    // [outer, inner]
BUFFER(1, readwrite, float, y);      // [outer, innerAll]
BUFFER(2, readonly, float, dy);      // [outer, innerAll]
BUFFER(3, writeonly, float, dpart);  // [outer, inner]
BUFFER(4, readonly, vec2, parts);    // the same, in pairs
BUFFER(5, readwrite, vec2, ys);
BUFFER(6, readonly, vec2, dys);
BUFFER(7, writeonly, vec2, dparts);

layout(constant_id = 1) const bool kRelu = false;  // y = max(0, …); its sign is that of the part

// Where element i of the part is in y.
uint place(uint i) {
    uint row = quotient(i, params.byInner);
    return row * params.innerAll + params.start + remainder(i, row, params.byInner);
}

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    float v = part.d[i];
    y.d[place(i)] = kRelu ? max(v, 0) : v;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint at = place(i);
    float g = dy.d[at];
    dpart.d[i] = !kRelu || y.d[at] > 0 ? g : 0;
}

// Where inner, innerAll and start are even.
ENTRY(forward_pairs) {
    EACH_PAIR(i, params.n) {
        vec2 v = parts.d[i];
        uint at = place(2 * i) / 2;
        ys.d[at] = kRelu ? max(v, vec2(0)) : v;
    }
}

ENTRY(backward_pairs) {
    EACH_PAIR(i, params.n) {
        uint at = place(2 * i) / 2;
        vec2 g = dys.d[at];
        if (kRelu) g = mix(vec2(0), g, greaterThan(ys.d[at], vec2(0)));
        dparts.d[i] = g;
    }
}
