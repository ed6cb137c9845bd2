#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "mesh/params.h"
// aggregate.comp for drivers that run lanes as a CPU's vector, where a load costs as much for eight
// bytes as for four: loads texels, stores pairs of columns, kPairColumns columns per invocation.
// Rows are multiples of 4.
PARAMS(AggregateParams, 6)
TEXELS(0, yQuads);                        // [V,row]
TEXELS(1, dyQuads);                       // [V,row]
BUFFER(2, readonly, int, neighbourBegin); // [V+1]
BUFFER(3, readonly, int, neighbours);     // [2E]
BUFFER(4, writeonly, uint64_t, dz);       // [V,2O]
TEXELS(5, dzQuads);                       // the same memory

layout(constant_id = 1) const bool kRelu = false;

const uint kQuads = kPairColumns / 4;

ENTRY(backward_own) {
    uint i = linearIndex(), pieces = params.outputs / kPairColumns;
    if (i >= params.vertices * pieces) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow) * kPairColumns;
    uint from = (v * params.row + column) / 4, to = (v * params.xRow + column) / 2;
    [[unroll]] for (uint k = 0; k < kQuads; ++k) {
        vec4 d = texelFetch(dyQuads, int(from + k));
        if (kRelu) d = mix(vec4(0), d, greaterThan(texelFetch(yQuads, int(from + k)), vec4(0)));
        dz.d[to + 2 * k] = packPair(d.xy);
        dz.d[to + 2 * k + 1] = packPair(d.zw);
    }
}

ENTRY(backward_neighbours) {
    uint i = linearIndex(), pieces = params.outputs / kPairColumns;
    if (i >= params.vertices * pieces) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow) * kPairColumns;
    vec4 sum[kQuads];
    [[unroll]] for (uint k = 0; k < kQuads; ++k) sum[k] = vec4(0);
    int end = neighbourBegin.d[v + 1];
    for (int n = neighbourBegin.d[v]; n < end; ++n) {
        uint at = (neighbours.d[n] * params.xRow + column) / 4;
        [[unroll]] for (uint k = 0; k < kQuads; ++k) sum[k] += texelFetch(dzQuads, int(at + k));
    }
    uint to = (v * params.xRow + params.outputs + column) / 2;
    [[unroll]] for (uint k = 0; k < kQuads; ++k) {
        dz.d[to + 2 * k] = packPair(sum[k].xy);
        dz.d[to + 2 * k + 1] = packPair(sum[k].zw);
    }
}
