#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(AggregateParams, 6)
BUFFER(0, readonly, float, x);      // [V,xRow]
BUFFER(1, readonly, float, tail);   // [V,3]
BUFFER(2, writeonly, float, y);     // [V,row] O features, tail, zeros
BUFFER(3, readonly, float, dy);     // [V,row]
BUFFER(4, writeonly, float, dx);    // [V,xRow]
BUFFER(5, writeonly, float, dtail); // [V,3]

// What follows the features, one invocation per vertex.
ENTRY(append) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    uint at = v * params.row + params.outputs;
    for (uint k = 0; k < 3; ++k) y.d[at + k] = tail.d[3 * v + k];
    for (uint k = at + 3; k < (v + 1) * params.row; ++k) y.d[k] = 0;
}

ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    uint at = v * params.row + params.outputs;
    for (uint k = 0; k < 3; ++k) dtail.d[3 * v + k] = dy.d[at + k];
}

// Features of x with another tail behind them, one invocation per number.
ENTRY(replace) {
    uint i = linearIndex();
    if (i >= params.vertices * params.row) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow);
    float value = 0;
    if (column < params.outputs)
        value = x.d[v * params.xRow + column];
    else if (column < params.outputs + 3)
        value = tail.d[3 * v + column - params.outputs];
    y.d[i] = value;
}

ENTRY(backward_replace) {
    uint i = linearIndex();
    if (i >= params.vertices * params.xRow) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow);
    dx.d[i] = column < params.outputs ? dy.d[v * params.row + column] : 0;
}
