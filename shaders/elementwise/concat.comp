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
    uint row = quotient(i, params.byInner), column = remainder(i, row, params.byInner);
    float v;
    if (column < params.innerA)
        v = a.d[row * params.innerA + column];
    else
        v = b.d[row * params.innerB + column - params.innerA];
    y.d[i] = v;
}

ENTRY(backward_a) {
    uint i = linearIndex();
    if (i >= params.n) return;
    da.d[i] = dy.d[i + quotient(i, params.byInner) * params.innerB];
}

ENTRY(backward_b) {
    uint i = linearIndex();
    if (i >= params.n) return;
    db.d[i] = dy.d[i + (quotient(i, params.byInner) + 1) * params.innerA];
}
