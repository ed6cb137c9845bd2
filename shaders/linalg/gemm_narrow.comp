#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "common/rows.glsl"
#include "linalg/params.h"
// C = A B^T (+ bias) for B of a few rows, for drivers that run lanes as a CPU's vector: a lane makes
// a row of C, and values of B are loaded by one lane each and handed out, as in gemm.glsl; sums are
// in its order and have its bits.
PARAMS(GemmParams, 5)
BUFFER(0, readonly, uint64_t, a);  // [m, k], rows and k even
BUFFER(1, readonly, uint64_t, b);  // [kColumns, k], likewise
BUFFER(2, writeonly, float, c);    // [m, kColumns]
BUFFER(3, readonly, float, bias);  // [kColumns]
ROW_TILES(4)

layout(constant_id = 1) const uint kLanes = 8;
layout(constant_id = 2) const uint kColumns = 3;
layout(constant_id = 3) const bool kBias = false;
const uint kPairs = kGemmUnroll / 2;  // of a row, in the loop's body
const uint kLoads = (kColumns * kPairs + kLanes - 1) / kLanes;

ENTRY(rows) {
    uint lane = gl_SubgroupInvocationID, pairs = params.k / 2;
    uint row = listedIndex(), start = (params.startA + min(row, params.m - 1) * params.lda) / 2;
    float sum[kColumns];
    [[unroll]] for (uint j = 0; j < kColumns; ++j) sum[j] = 0;
    for (uint k = 0; k < pairs; k += kPairs) {
        vec2 ofB[kLoads];  // column e / kPairs, pair e % kPairs of the body
        [[unroll]] for (uint t = 0; t < kLoads; ++t) {
            uint e = min(t * kLanes + lane, kColumns * kPairs - 1);
            uint at = params.startB / 2 + e / kPairs * (params.ldb / 2);
            ofB[t] = unpackPair(b.d[at + min(k + e % kPairs, pairs - 1)]);
        }
        [[unroll]] for (uint u = 0; u < kPairs; ++u) {
            vec2 own = unpackPair(a.d[start + min(k + u, pairs - 1)]);
            if (k + u >= pairs) own = vec2(0);
            [[unroll]] for (uint j = 0; j < kColumns; ++j) {
                uint e = j * kPairs + u;
                sum[j] += own.x * subgroupBroadcast(ofB[e / kLanes].x, e % kLanes);
                sum[j] += own.y * subgroupBroadcast(ofB[e / kLanes].y, e % kLanes);
            }
        }
    }
    if (row >= params.m) return;
    [[unroll]] for (uint j = 0; j < kColumns; ++j)
        c.d[params.startC + row * params.ldc + j] = kBias ? sum[j] + bias.d[j] : sum[j];
}
