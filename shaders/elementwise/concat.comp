#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "elementwise/params.h"
PARAMS(ConcatParams, 6)
BUFFER(0, readonly, float, a);    // [outer, innerA]
BUFFER(1, readonly, float, b);    // [outer, innerB]
BUFFER(2, writeonly, float, y);   // [outer, innerA + innerB]
BUFFER(3, readonly, float, dy);   // [outer, innerA + innerB]
BUFFER(4, writeonly, float, da);  // [outer, innerA]
BUFFER(5, writeonly, float, db);  // [outer, innerB]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint inner = params.innerA + params.innerB, row = i / inner, column = i % inner;
    if (column < params.innerA)
        y.d[i] = a.d[row * params.innerA + column];
    else
        y.d[i] = b.d[row * params.innerB + column - params.innerA];
}

// n counts the elements of da, of db.
ENTRY(backward_a) {
    uint i = linearIndex();
    if (i >= params.n) return;
    da.d[i] = dy.d[i / params.innerA * (params.innerA + params.innerB) + i % params.innerA];
}

ENTRY(backward_b) {
    uint i = linearIndex();
    if (i >= params.n) return;
    db.d[i] = dy.d[i / params.innerB * (params.innerA + params.innerB) + params.innerA +
                   i % params.innerB];
}
