// C = A B (+ bias) (+ C), or that clamped (kClamp), on matrix units: A [m, k] and B [k, n] as
// panels of halves (common/panels.h), C in single precision; batches of them. A workgroup is one
// subgroup and makes a tile of kMatrixFragments squared of the device's matrices, whose sums stay
// in registers; panels are as wide as the tile. Elsewhere gemm.comp computes the same sums.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/cooperative_matrix.glsl"
#include "linalg/params.h"
#include "linalg/half_scale.glsl"
PARAMS(GemmParams, 5)
BUFFER(0, readonly, float16_t, a);   // [batch, panels, steps, tile's rows]
BUFFER(1, readonly, float16_t, b);   // [batch, panels, steps, tile's columns]
BUFFER(2, readwrite, float, c);      // [parts, batch, m, n]
BUFFER(3, readonly, float, bias);    // [n] or [m], see kBias
BUFFER(4, readonly, uint, largest);  // [1], see kScaled

layout(constant_id = 1) const bool kAccumulate = false;
layout(constant_id = 2) const uint kBias = 0;  // 1: one per column, 2: one per row
layout(constant_id = 3) const uint kClamp = 0;  // 1: to positive numbers, 2: to [0, 6]
// A or B was multiplied by halfScale(largest).
layout(constant_id = 4) const bool kScaled = false;
// Tiles are whole and results go to memory as they are.
layout(constant_id = 5) const bool kDirect = false;

shared float staged[kMatrixM * kMatrixN];

ENTRY(tile) {
    const uint kTileRows = kMatrixFragments * kMatrixM, kTileColumns = kMatrixFragments * kMatrixN;
    uint part = gl_WorkGroupID.z / params.batch, matrix = gl_WorkGroupID.z % params.batch;
    uint begin = part * params.kPart, end = min(params.k, begin + params.kPart);
    uint baseA = params.startA + matrix * params.strideA + gl_WorkGroupID.x * params.lda;
    uint baseB = params.startB + matrix * params.strideB + gl_WorkGroupID.y * params.ldb;

    MatrixC sum[kMatrixFragments][kMatrixFragments];
    [[unroll]] for (uint i = 0; i < kMatrixFragments; ++i)
        [[unroll]] for (uint j = 0; j < kMatrixFragments; ++j) sum[i][j] = matrixOf(0.0);
    // Behind k panels are zero up to a multiple of any device's steps.
    for (uint k = begin; k < end; k += kMatrixK) {
        MatrixA left[kMatrixFragments];
        [[unroll]] for (uint i = 0; i < kMatrixFragments; ++i)
            left[i] = matrixLoadA(a.d[baseA + k * kTileRows + i * kMatrixM], kColumnMajor,
                                  kTileRows, kAligned, 16);
        [[unroll]] for (uint j = 0; j < kMatrixFragments; ++j) {
            MatrixB right = matrixLoadB(b.d[baseB + k * kTileColumns + j * kMatrixN], kRowMajor,
                                        kTileColumns, kAligned, 16);
            [[unroll]] for (uint i = 0; i < kMatrixFragments; ++i)
                sum[i][j] = matrixMulAdd(left[i], right, sum[i][j]);
        }
    }
    float scale = 1;
    if (kScaled) scale = 1 / halfScale(largest.d[0]);

    uint baseC =
        params.startC + part * params.batch * params.m * params.n + matrix * params.strideC;
    [[unroll]] for (uint i = 0; i < kMatrixFragments; ++i) {
        [[unroll]] for (uint j = 0; j < kMatrixFragments; ++j) {
            uint row = gl_WorkGroupID.x * kTileRows + i * kMatrixM;
            uint column = gl_WorkGroupID.y * kTileColumns + j * kMatrixN;
            if (kScaled) sum[i][j] = matrixScale(sum[i][j], scale);
            if (kDirect) {
                matrixStore(c.d[baseC + row * params.ldc + column], sum[i][j], kRowMajor,
                            params.ldc, kAligned, 4);
                continue;
            }
            matrixStore(staged[0], sum[i][j], kRowMajor, kMatrixN, kAlignedShared, 4);
            barrier();
            for (uint e = localIndex(); e < kMatrixM * kMatrixN;
                 e += gl_WorkGroupSize.x) {
                uint r = row + e / kMatrixN, s = column + e % kMatrixN;
                if (r >= params.m || s >= params.n) continue;
                uint at = baseC + r * params.ldc + s;
                float v = staged[e];
                if (kBias == 1) v += bias.d[s];
                if (kBias == 2) v += bias.d[r];
                if (kAccumulate) v += c.d[at];
                if (kClamp > 0) v = max(v, 0.0);
                if (kClamp > 1) v = min(v, 6.0);
                c.d[at] = v;
            }
            barrier();
        }
    }
}
