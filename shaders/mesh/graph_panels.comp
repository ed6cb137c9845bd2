// The left side of a graph convolution's product, in panels of vertices (common/panels.h). A vertex
// has the columns
//
//     [x_i, 1, zeros | sum over the neighbours of x_j, their number, zeros],  H and H of them,
//
// so that one product with [weight0, bias0, zeros | weight1, bias1, zeros] is the graph convolution
// y_i = W0 x_i + b0 + sum over j of (W1 x_j + b1) of Kipf and Welling, Semi-Supervised
// Classification with Graph Convolutional Networks, ICLR 2017, in the form without normalisation.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/panels.h"
#include "common/rows.glsl"
#include "mesh/params.h"
PARAMS(GraphPanelsParams, 6)
QUADS(0, quads);                           // [V,row], row being a multiple of 4
BUFFER(1, readonly, int, neighbourBegin);  // [V+1]
BUFFER(2, readonly, int, neighbours);      // [2E]
BUFFER(3, writeonly, Pair, panels);        // [ceil(V/kRows), 2 H, kRows] of all or listed rows
LISTED_ROWS(4)
BUFFER(5, readonly, float, x);             // as quads, of any row

layout(constant_id = 1) const uint kRows = 8;
layout(constant_id = 2) const uint kColumns =
    4;  // of an invocation; a multiple of 4 that H is one of
layout(constant_id = 3) const bool kQuads = true;  // row is a multiple of 4

// Four columns of a vertex; what is behind its inputs is not used.
vec4 columnsAt(uint vertex, uint column) {
    uint at = vertex * params.row + column;
    if (CPU == 0 && column >= params.row) return vec4(0);  // texels are zeros behind the end
    if (kQuads) return quadAt(quads, at / 4);
    vec4 v = vec4(0);
    [[unroll]] for (uint k = 0; k < 4; ++k)
        if (column + k < params.inputs) v[k] = x.d[at + k];
    return v;
}

// One invocation per two vertices and kColumns columns of the left half.
ENTRY(gather) {
    uint i = listedIndex(), H = params.halfColumns;
    uint v = quotient(i, params.byPieces), column = remainder(i, v, params.byPieces) * kColumns;
    v *= 2;
    if (v >= params.vertices) return;
    // Panels have the listed rows one after the other.
    uint place = kListedInvocations == 0 ? v : 2 * quotient(linearIndex(), params.byPieces);
    vec4 own[2][kColumns / 4], sum[2][kColumns / 4];
    [[unroll]] for (uint t = 0; t < 2; ++t) {
        uint vertex = min(v + t, params.vertices - 1);
        [[unroll]] for (uint k = 0; k < kColumns / 4; ++k) {
            own[t][k] = columnsAt(vertex, column + 4 * k);
            sum[t][k] = vec4(0);
        }
        int begin = neighbourBegin.d[vertex], end = neighbourBegin.d[vertex + 1];
        for (int n = begin; n < end; ++n) {
            uint neighbour = neighbours.d[n];
            [[unroll]] for (uint k = 0; k < kColumns / 4; ++k)
                sum[t][k] += columnsAt(neighbour, column + 4 * k);
        }
        if (column + kColumns > params.inputs) {
            [[unroll]] for (uint k = 0; k < kColumns; ++k) {
                if (column + k < params.inputs) continue;
                bool one = column + k == params.inputs;
                own[t][k / 4][k % 4] = one ? 1 : 0;
                sum[t][k / 4][k % 4] = one ? float(end - begin) : 0;
            }
        }
    }
    uint left = panelIndex(place, column, 2 * H, kRows), right = left + H * kRows;
    [[unroll]] for (uint k = 0; k < kColumns; ++k) {
        uint at = placeInPanel(0, k, kRows);
        panels.d[(left + at) / 2] = packPair(vec2(own[0][k / 4][k % 4], own[1][k / 4][k % 4]));
        panels.d[(right + at) / 2] = packPair(vec2(sum[0][k / 4][k % 4], sum[1][k / 4][k % 4]));
    }
}
