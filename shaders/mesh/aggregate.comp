// The gradient of a graph convolution's results, y_i = W0 x_i + b0 + sum over the neighbours j of
// (W1 x_j + b1), spread over both products: dz_i = [dy_i | sum over the neighbours j of dy_j], for
// neighbours are mutual. With kRelu dy counts where y > 0. mesh/graph_panels.comp is the way there.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "mesh/params.h"
PARAMS(AggregateParams, 9)
BUFFER(0, readonly, int, neighbourBegin);  // [V+1]
BUFFER(1, readonly, int, neighbours);      // [2E]
BUFFER(2, readonly, float, y);             // [V,row] O results and whatever follows
BUFFER(3, readonly, float, dy);            // [V,row]
BUFFER(4, readwrite, float, dz);           // [V,2O] from itself, from neighbours
BUFFER(5, readonly, vec4, yQuads);         // the same as y, dy and dz
BUFFER(6, readonly, vec4, dyQuads);
BUFFER(7, readonly, vec4, dzQuads);
BUFFER(8, writeonly, vec4, dzStored);

layout(constant_id = 1) const bool kRelu = false;
layout(constant_id = 2) const uint kColumns = 4;  // of an invocation that takes quads

// One invocation per vertex and column.
ENTRY(backward_own) {
    uint i = linearIndex();
    if (i >= params.vertices * params.outputs) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow);
    uint at = v * params.row + column;
    dz.d[v * params.xRow + column] = kRelu && !(y.d[at] > 0) ? 0 : dy.d[at];
}

// Neighbours are mutual: what a vertex gave to others comes back from the same ones.
ENTRY(backward_neighbours) {
    uint i = linearIndex();
    if (i >= params.vertices * params.outputs) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow);
    float sum = 0;
    int end = neighbourBegin.d[v + 1];
    for (int n = neighbourBegin.d[v]; n < end; ++n)
        sum += dz.d[neighbours.d[n] * params.xRow + column];
    dz.d[v * params.xRow + params.outputs + column] = sum;
}

// The same four columns at a time, for rows and results that are multiples of four; kColumns of them
// per invocation, each of which reads the list of neighbours for itself.
const uint kQuads = kColumns / 4;

ENTRY(backward_own_quads) {
    uint i = linearIndex(), pieces = params.outputs / kColumns;
    if (i >= params.vertices * pieces) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow) * kColumns;
    uint from = (v * params.row + column) / 4, to = (v * params.xRow + column) / 4;
    [[unroll]] for (uint k = 0; k < kQuads; ++k) {
        vec4 d = dyQuads.d[from + k];
        if (kRelu) d = mix(vec4(0), d, greaterThan(yQuads.d[from + k], vec4(0)));
        dzStored.d[to + k] = d;
    }
}

ENTRY(backward_neighbours_quads) {
    uint i = linearIndex(), pieces = params.outputs / kColumns;
    if (i >= params.vertices * pieces) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow) * kColumns;
    vec4 sum[kQuads];
    [[unroll]] for (uint k = 0; k < kQuads; ++k) sum[k] = vec4(0);
    int end = neighbourBegin.d[v + 1];
    for (int n = neighbourBegin.d[v]; n < end; ++n) {
        uint at = (neighbours.d[n] * params.xRow + column) / 4;
        [[unroll]] for (uint k = 0; k < kQuads; ++k) sum[k] += dzQuads.d[at + k];
    }
    uint to = (v * params.xRow + params.outputs + column) / 4;
    [[unroll]] for (uint k = 0; k < kQuads; ++k) dzStored.d[to + k] = sum[k];
}
