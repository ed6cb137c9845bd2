// C [m, n] = op(A) op(B) (+ bias) of up to four columns, for CPUs: each lane has rows of C of its
// own, and values of B are loaded by one lane each and handed out, as in gemm.comp; sums are in its
// order and have its bits. Matrices start at quads, and so do their rows. `columns` sums A's
// columns as well, which are the gradient of a bias.
#version 460
// VARIANTS: cpu
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/rows.glsl"
#include "linalg/params.h"
PARAMS(GemmParams, 6)
QUADS(0, a);                       // rows: [m, k]; columns: [k, m]
QUADS(1, b);                       // [k, kColumns] or, kTransB, [kColumns, k]
BUFFER(2, writeonly, float, c);    // [parts, m, kColumns]
BUFFER(3, readonly, float, bias);  // [kColumns] or [m], see kBias
LISTED_ROWS(4)
BUFFER(5, writeonly, float, sums);  // [parts, m], see kSums

layout(constant_id = 1) const uint kLanes = 8;
layout(constant_id = 2) const uint kColumns = 3;
layout(constant_id = 3) const uint kBias = 0;  // 1: one per column, 2: one per row
layout(constant_id = 4) const bool kTransB = true;  // B lies as [kColumns, k]
layout(constant_id = 5) const bool kSums = false;   // of A's columns too
// In the loop's body B has a texel for each step, or, transposed, for four steps of a column.
const uint kQuads = kGemmUnroll / 4, kTexels = kTransB ? kColumns * kQuads : kGemmUnroll;
const uint kLoads = (kTexels + kLanes - 1) / kLanes;

vec4 loadB(uint e, uint k, uint end) {
    uint at = kTransB ? e / kQuads * params.ldb + min(k + 4 * (e % kQuads), end - 4)
                      : min(k + e, end - 1) * params.ldb;
    return quadAt(b, (params.startB + at) / 4);
}
// B[k + u, j] of this body.
float valueB(vec4 loaded[kLoads], uint u, uint j) {
    uint e = kTransB ? j * kQuads + u / 4 : u;
    return subgroupBroadcast(loaded[e / kLanes][kTransB ? u % 4 : j], e % kLanes);
}

// A lies as [m, k], k a multiple of 4: a row per lane.
ENTRY(rows) {
    uint lane = gl_SubgroupInvocationID, row = listedIndex();
    uint start = params.startA + min(row, params.m - 1) * params.lda;
    float sum[kColumns];
    [[unroll]] for (uint j = 0; j < kColumns; ++j) sum[j] = 0;
    for (uint k = 0; k < params.k; k += kGemmUnroll) {
        vec4 ofB[kLoads], own[kQuads];
        [[unroll]] for (uint t = 0; t < kLoads; ++t)
            ofB[t] = loadB(min(t * kLanes + lane, kTexels - 1), k, params.k);
        [[unroll]] for (uint q = 0; q < kQuads; ++q) {
            own[q] = quadAt(a, (start + min(k + 4 * q, params.k - 4)) / 4);
            if (k + 4 * q >= params.k) own[q] = vec4(0);
        }
        [[unroll]] for (uint u = 0; u < kGemmUnroll; ++u)
            [[unroll]] for (uint j = 0; j < kColumns; ++j)
                sum[j] += own[u / 4][u % 4] * valueB(ofB, u, j);
    }
    if (row >= params.m) return;
    float ofRow = kBias == 2 ? bias.d[row] : 0;
    [[unroll]] for (uint j = 0; j < kColumns; ++j)
        c.d[params.startC + row * params.ldc + j] = sum[j] + (kBias == 1 ? bias.d[j] : ofRow);
}

// A lies as [k, m], m a multiple of 4: four rows of C per lane, and as in gemm.comp parts of k.
ENTRY(columns) {
    uint lane = gl_SubgroupInvocationID, row = 4 * (gl_WorkGroupID.x * kLanes + lane);
    uint part = gl_WorkGroupID.z, begin = part * params.kPart;
    uint end = min(params.k, begin + params.kPart);
    uint start = params.startA + min(row, params.m - 4);
    vec4 sum[kColumns];
    vec4 total = vec4(0);
    [[unroll]] for (uint j = 0; j < kColumns; ++j) sum[j] = vec4(0);
    for (uint k = begin; k < end; k += kGemmUnroll) {
        vec4 ofB[kLoads];
        [[unroll]] for (uint t = 0; t < kLoads; ++t)
            ofB[t] = loadB(min(t * kLanes + lane, kTexels - 1), k, end);
        [[unroll]] for (uint u = 0; u < kGemmUnroll; ++u) {
            vec4 own = quadAt(a, (start + min(k + u, end - 1) * params.lda) / 4);
            if (k + u >= end) own = vec4(0);
            [[unroll]] for (uint j = 0; j < kColumns; ++j) sum[j] += own * valueB(ofB, u, j);
            if (kSums) total += own;
        }
    }
    if (row >= params.m) return;
    uint to = params.startC + part * params.m * params.n;
    [[unroll]] for (uint i = 0; i < 4; ++i) [[unroll]] for (uint j = 0; j < kColumns; ++j)
        c.d[to + (row + i) * params.ldc + j] = sum[j][i];
    if (!kSums) return;
    [[unroll]] for (uint i = 0; i < 4; ++i) sums.d[part * params.m + row + i] = total[i];
}
