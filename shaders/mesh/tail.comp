// Rows of features with a tail of three numbers and zeros behind: y = [x, tail, zeros], [V,row],
// row a multiple of four. `append` writes what is behind features that are there already, `replace`
// all of a row; backward takes dy apart.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/rows.glsl"
#include "mesh/params.h"
PARAMS(AggregateParams, 7)
BUFFER(0, readonly, float, x);      // [V,xRow]
BUFFER(1, readonly, float, tail);   // [V,3]
BUFFER(2, writeonly, float, y);     // [V,row] O features, tail, zeros
BUFFER(3, readonly, float, dy);     // [V,row]
BUFFER(4, writeonly, float, dx);    // [V,xRow]
BUFFER(5, writeonly, float, dtail); // [V,3]
LISTED_ROWS(6)

// What follows the features, one invocation per vertex.
ENTRY(append) {
    uint v = listedIndex();
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

// Features of x with another tail behind them, one invocation per four numbers of a row.
ENTRY(replace) {
    uint i = listedIndex();
    uint v = quotient(i, params.byRow), first = 4 * remainder(i, v, params.byRow);
    if (v >= params.vertices) return;
    [[unroll]] for (uint k = 0; k < 4; ++k) {
        uint column = first + k;
        float value = 0;
        if (column < params.outputs)
            value = x.d[v * params.xRow + column];
        else if (column < params.outputs + 3)
            value = tail.d[3 * v + column - params.outputs];
        y.d[v * params.row + column] = value;
    }
}

ENTRY(backward_replace) {
    uint i = linearIndex();
    if (i >= params.vertices * params.xRow) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow);
    dx.d[i] = column < params.outputs ? dy.d[v * params.row + column] : 0;
}
