// The gradient of a graph convolution's results, y_i = W0 x_i + b0 + sum over the neighbours j of
// (W1 x_j + b1), spread over both products: dz_i = [dy_i | sum over the neighbours j of dy_j], for
// neighbours are mutual. With kRelu dy counts where y > 0. mesh/graph_panels.comp is the way there.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(AggregateParams, 5)
BUFFER(0, readonly, int, neighbourBegin); // [V+1]
BUFFER(1, readonly, int, neighbours);     // [2E]
BUFFER(2, readonly, float, y);            // [V,row] O results and whatever follows
BUFFER(3, readonly, float, dy);           // [V,row]
BUFFER(4, readwrite, float, dz);          // [V,2O] from itself, from neighbours

layout(constant_id = 1) const bool kRelu = false;

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
