#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "common/op.glsl"
#include "mesh/params.h"
// aggregate.comp for drivers that run lanes as a CPU's vector, where a load costs as much for eight
// bytes as for four: pairs of columns, kPairColumns columns per invocation. Rows are even.
PARAMS(AggregateParams, 7)
BUFFER(0, readonly, uint64_t, z);         // [V,2O]
BUFFER(1, readonly, int, neighbourBegin); // [V+1]
BUFFER(2, readonly, int, neighbours);     // [2E]
BUFFER(3, readwrite, uint64_t, y);        // [V,row]
BUFFER(4, readonly, uint64_t, dy);        // [V,row]
BUFFER(5, readwrite, uint64_t, dz);       // [V,2O]
TEXELS(6, dzQuads);                       // the same memory

layout(constant_id = 1) const bool kRelu = false;

const uint kPairs = kPairColumns / 2;

vec2 unpackPair(uint64_t pair) { return uintBitsToFloat(unpackUint2x32(pair)); }
uint64_t packPair(vec2 pair) { return packUint2x32(floatBitsToUint(pair)); }

ENTRY(backward_own) {
    uint i = linearIndex(), pieces = params.outputs / kPairColumns;
    if (i >= params.vertices * pieces) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow) * kPairs;
    uint from = v * (params.row / 2) + column, to = v * (params.xRow / 2) + column;
    [[unroll]] for (uint k = 0; k < kPairs; ++k) {
        vec2 d = unpackPair(dy.d[from + k]);
        if (kRelu) d = mix(vec2(0), d, greaterThan(unpackPair(y.d[from + k]), vec2(0)));
        dz.d[to + k] = packPair(d);
    }
}

ENTRY(backward_neighbours) {
    uint i = linearIndex(), pieces = params.outputs / kPairColumns;
    if (i >= params.vertices * pieces) return;
    uint v = quotient(i, params.byRow), column = remainder(i, v, params.byRow) * kPairs;
    uint zRow = params.xRow / 2;
    vec4 sum[kPairs / 2];
    [[unroll]] for (uint k = 0; k < kPairs / 2; ++k) sum[k] = vec4(0);
    int end = neighbourBegin.d[v + 1];
    for (int n = neighbourBegin.d[v]; n < end; ++n) {
        uint at = (neighbours.d[n] * zRow + column) / 2;
        [[unroll]] for (uint k = 0; k < kPairs / 2; ++k) sum[k] += texelFetch(dzQuads, int(at + k));
    }
    uint at = v * zRow + params.outputs / 2 + column;
    [[unroll]] for (uint k = 0; k < kPairs; ++k)
        dz.d[at + k] = packPair(k % 2 == 0 ? sum[k / 2].xy : sum[k / 2].zw);
}
