#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "mesh/params.h"
// The left side of a graph convolution's product, in panels (linalg/gemm.glsl). A vertex has the
// columns
//
//     [x_i, 1, zeros | sum over the neighbours of x_j, their number, zeros],  H and H of them,
//
// so that one product with [weight0, bias0, zeros | weight1, bias1, zeros] does it all.
PARAMS(GraphPanelsParams, 4)
BUFFER(0, readonly, float, x);             // [V,row]
BUFFER(1, readonly, int, neighbourBegin);  // [V+1]
BUFFER(2, readonly, int, neighbours);      // [2E]
BUFFER(3, writeonly, float, panels);       // [ceil(V/kRows), 2 H, kRows]

layout(constant_id = 1) const uint kRows = 8;

// One invocation per vertex and column of the left half.
ENTRY(gather) {
    uint i = linearIndex(), H = params.halfColumns;
    if (i >= params.vertices * H) return;
    uint v = quotient(i, params.byPieces), column = remainder(i, v, params.byPieces);
    int begin = neighbourBegin.d[v], end = neighbourBegin.d[v + 1];
    float own = 0, sum = 0;
    if (column < params.inputs) {
        own = x.d[v * params.row + column];
        for (int n = begin; n < end; ++n) sum += x.d[neighbours.d[n] * params.row + column];
    } else if (column == params.inputs) {
        own = 1;
        sum = float(end - begin);
    }
    uint to = v / kRows * (2 * H * kRows) + v % kRows;
    panels.d[to + column * kRows] = own;
    panels.d[to + (H + column) * kRows] = sum;
}
