#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "elementwise/params.h"
PARAMS(ConcatParams, 8)
BUFFER(0, readonly, float, part);     // [outer, inner]
BUFFER(1, readwrite, float, y);       // [outer, innerAll]
BUFFER(2, readonly, float, dy);       // [outer, innerAll]
BUFFER(3, writeonly, float, dpart);   // [outer, inner]
BUFFER(4, readonly, uint64_t, parts);    // the same, in pairs
BUFFER(5, readwrite, uint64_t, ys);
BUFFER(6, readonly, uint64_t, dys);
BUFFER(7, writeonly, uint64_t, dparts);

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
    uint n = params.n;
    EACH_PAIR(i, n) {
        vec2 v = unpackPair(parts.d[i]);
        ys.d[place(2 * i) / 2] = packPair(kRelu ? max(v, vec2(0)) : v);
    }
}

ENTRY(backward_pairs) {
    uint n = params.n;
    EACH_PAIR(i, n) {
        uint at = place(2 * i) / 2;
        vec2 g = unpackPair(dys.d[at]);
        if (kRelu) g = mix(vec2(0), g, greaterThan(unpackPair(ys.d[at]), vec2(0)));
        dparts.d[i] = packPair(g);
    }
}
