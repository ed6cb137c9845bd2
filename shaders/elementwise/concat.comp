// Copies a part [outer, inner] to its columns of y [outer, innerAll], from column `start` on, or
// the gradient of these back; with kRelu y = max(0, part), whose gradient is 0 where y is.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ConcatParams, 8)
#include "common/blocks.glsl"
BUFFER(0, readonly, float, part);     // [outer, inner]
BUFFER(1, readwrite, float, y);       // [outer, innerAll]
BUFFER(2, readonly, float, dy);       // [outer, innerAll]
BUFFER(3, writeonly, float, dpart);   // [outer, inner]
BUFFER(4, readonly, Block, parts);    // the same, in pairs
BUFFER(5, readwrite, Block, ys);
BUFFER(6, readonly, Block, dys);
BUFFER(7, writeonly, Pair, dparts);

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

// Where in y the pairs of place p of the part are; in blocks if these are whole in both.
Place placeInY(Place p) {
    uint elements = kBlockElements;
    return Place(place(p.block * elements) / elements, p.part, place(2 * p.pair) / 2);
}

// Where inner, innerAll and start are even.
ENTRY(forward_pairs) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        vec2 v = PAIR(parts, p);
        Place at = placeInY(p);
        BLOCK_PAIR(ys, at) = packPair(kRelu ? max(v, vec2(0)) : v);
    }
}

ENTRY(backward_pairs) {
    uint n = params.n;
    EACH_PLACE(p, n) {
        Place at = placeInY(p);
        vec2 g = PAIR(dys, at);
        if (kRelu) g = mix(vec2(0), g, greaterThan(PAIR(ys, at), vec2(0)));
        dparts.d[p.pair] = packPair(g);
    }
}
