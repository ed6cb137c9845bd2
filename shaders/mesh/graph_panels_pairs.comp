#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "common/rows.glsl"
#include "mesh/params.h"
// graph_panels.comp for drivers that run lanes as a CPU's vector: loads texels of columns, stores
// pairs of vertices. row is a multiple of 4, and H one of kColumns; what is loaded from behind a row
// is not used.
PARAMS(GraphPanelsParams, 5)
TEXELS(0, x);                              // [V,row]
BUFFER(1, readonly, int, neighbourBegin);  // [V+1]
BUFFER(2, readonly, int, neighbours);      // [2E]
BUFFER(3, writeonly, uint64_t, panels);    // [ceil(V/kRows), 2 H, kRows] of all or listed rows
LISTED_ROWS(4)

layout(constant_id = 1) const uint kRows = 8;
layout(constant_id = 2) const uint kColumns = 4;  // of an invocation; a multiple of 4

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
        uint vertex = min(v + t, params.vertices - 1), at = (vertex * params.row + column) / 4;
        [[unroll]] for (uint k = 0; k < kColumns / 4; ++k) {
            own[t][k] = texelFetch(x, int(at + k));
            sum[t][k] = vec4(0);
        }
        int begin = neighbourBegin.d[vertex], end = neighbourBegin.d[vertex + 1];
        for (int n = begin; n < end; ++n) {
            at = (neighbours.d[n] * params.row + column) / 4;
            [[unroll]] for (uint k = 0; k < kColumns / 4; ++k) sum[t][k] += texelFetch(x, int(at + k));
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
    uint to = place / kRows * (2 * H * kRows) + place % kRows + column * kRows;
    [[unroll]] for (uint k = 0; k < kColumns; ++k) {
        panels.d[(to + k * kRows) / 2] = packPair(vec2(own[0][k / 4][k % 4], own[1][k / 4][k % 4]));
        panels.d[(to + (H + k) * kRows) / 2] =
            packPair(vec2(sum[0][k / 4][k % 4], sum[1][k / 4][k % 4]));
    }
}
