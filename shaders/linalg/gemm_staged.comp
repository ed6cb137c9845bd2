// C = op(A) op(B) (+ bias) (+ C), or that clamped, on GPUs; A is [m, k], B [k, n], batches
// of them.
//
// A workgroup makes a tile of kSide rows and columns. It brings A and B into shared memory, kDepth
// steps of k at a time, from wherever they lie: rows, transposed, panels (common/panels.h). While
// each invocation sums 8 rows of kSide / 16 columns in registers from there, its numbers of the
// next steps are on their way. Neighbours load what is side by side in memory. Sums over k may be
// cut into parts, which gemm_reduce.comp adds up. On a CPU gemm.comp computes the same sums.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/panels.h"
#include "linalg/half_scale.glsl"
#include "linalg/params.h"
PARAMS(GemmParams, 8)
BUFFER(0, readonly, float, a);       // [batch, m, k] as kLayoutA says
BUFFER(1, readonly, float, b);       // [batch, k, n] as kLayoutB says
BUFFER(2, readwrite, float, c);      // [parts, batch, m, n]
BUFFER(3, readonly, float, bias);    // [n] or [m]
BUFFER(4, readonly, uint, largest);  // [1], see kGemmScaled
BUFFER(5, readonly, vec4, aQuads);   // a again
BUFFER(6, readonly, vec4, bQuads);   // b again
BUFFER(7, readwrite, vec4, cQuads);  // c again

layout(constant_id = 1) const uint kSide = 64;   // or 128
layout(constant_id = 2) const uint kLayoutA = 0;  // rows, transposed or row panels
layout(constant_id = 3) const uint kLayoutB = 0;  // rows, transposed or column panels
layout(constant_id = 4) const uint kPanelA = 8;   // rows of a panel of A
layout(constant_id = 5) const uint kPanelB = 64;  // columns of one of B
// A and B are panels of halves, two to a word.
layout(constant_id = 6) const bool kHalves = false;
layout(constant_id = 7) const uint kTraits = 0;  // of linalg/params.h

const uint kAcross = 16;  // invocations along a row of the tile
const uint kInvocations = 2 * kSide, kDepth = 1024 / kSide;
const uint kQuads = 256 / kInvocations;  // that an invocation brings, of four items at one step
// A step's quads, and one that keeps neighbouring steps out of each other's banks.
const uint kPitch = kSide / 4 + 1;
const uint kRowQuads = 2, kColumnQuads = kSide / (4 * kAcross);
shared vec4 stagedA[kDepth * kPitch], stagedB[kDepth * kPitch];

// Where neighbours in memory follow one another along k, or how many quads of items (rows of A,
// columns of B) do before the next step's.
const bool kStepsFirstA = kLayoutA == kLayoutRows, kStepsFirstB = kLayoutB == kLayoutTransposed;
const uint kRunA = (kLayoutA == kLayoutRowPanels ? kPanelA : kSide) / 4;

// Quad of items and step of the tile's quad e, in the order of memory.
uvec2 quadAndStep(uint e, bool stepsFirst, uint run) {
    if (stepsFirst) return uvec2(e / kDepth, e % kDepth);
    return uvec2(e / (run * kDepth) * run + e % run, e / run % kDepth);
}

bool has(uint trait) { return (kTraits & trait) != 0; }
float halfOf(float word, uint at) { return unpackHalf2x16(floatBitsToUint(word))[at % 2]; }
float oneOfA(uint at) { return kHalves ? halfOf(a.d[at / 2], at) : a.d[at]; }
float oneOfB(uint at) { return kHalves ? halfOf(b.d[at / 2], at) : b.d[at]; }
vec4 loadA(uvec4 at) {
    if (has(kGemmQuadsA)) return aQuads.d[at.x / 4];
    return vec4(oneOfA(at.x), oneOfA(at.y), oneOfA(at.z), oneOfA(at.w));
}
vec4 loadB(uvec4 at) {
    if (has(kGemmQuadsB)) return bQuads.d[at.x / 4];
    return vec4(oneOfB(at.x), oneOfB(at.y), oneOfB(at.z), oneOfB(at.w));
}

ENTRY(tile) {
    uint index = localIndex(), across = index % kAcross, down = index / kAcross;
    uint m = params.m, n = params.n;
    uint tileRow = gl_WorkGroupID.x * kSide, tileColumn = gl_WorkGroupID.y * kSide;
    uint part = gl_WorkGroupID.z / params.batch, matrix = gl_WorkGroupID.z % params.batch;
    uint begin = part * params.kPart, end = min(params.k, begin + params.kPart);

    // What this invocation brings: where it lies at step 0, and where it goes. Behind the matrices'
    // ends the last row and column are read again, whose products go nowhere.
    uvec2 ofA[kQuads], ofB[kQuads];
    uvec4 startA[kQuads], startB[kQuads];
    uint strideA = 1, strideB = 1;
    if (kLayoutA == kLayoutTransposed) strideA = params.lda;
    if (kLayoutA == kLayoutRowPanels) strideA = kPanelA;
    if (kLayoutB == kLayoutRows) strideB = params.ldb;
    if (kLayoutB == kLayoutColumnPanels) strideB = kPanelB;
    [[unroll]] for (uint i = 0; i < kQuads; ++i) {
        ofA[i] = quadAndStep(i * kInvocations + index, kStepsFirstA, kRunA);
        ofB[i] = quadAndStep(i * kInvocations + index, kStepsFirstB, kSide / 4);
        uvec4 row = min(tileRow + 4 * ofA[i].x + uvec4(0, 1, 2, 3), uvec4(m - 1));
        uvec4 column = min(tileColumn + 4 * ofB[i].x + uvec4(0, 1, 2, 3), uvec4(n - 1));
        if (has(kGemmQuadsA)) row.x = min(tileRow + 4 * ofA[i].x, (m - 1) / 4 * 4);
        if (has(kGemmQuadsB)) column.x = min(tileColumn + 4 * ofB[i].x, (n - 1) / 4 * 4);
        startA[i] = uvec4(params.startA + matrix * params.strideA);
        if (kLayoutA == kLayoutRows) startA[i] += row * params.lda;
        if (kLayoutA == kLayoutTransposed) startA[i] += row;
        if (kLayoutA == kLayoutRowPanels) startA[i] += row / kPanelA * params.lda + row % kPanelA;
        startB[i] = uvec4(params.startB + matrix * params.strideB);
        if (kLayoutB == kLayoutRows) startB[i] += column;
        if (kLayoutB == kLayoutTransposed) startB[i] += column * params.ldb;
        if (kLayoutB == kLayoutColumnPanels)
            startB[i] += column / kPanelB * params.ldb + column % kPanelB;
    }

    vec4 sum[4 * kRowQuads][kColumnQuads];
    [[unroll]] for (uint i = 0; i < 4 * kRowQuads; ++i)
        [[unroll]] for (uint j = 0; j < kColumnQuads; ++j) sum[i][j] = vec4(0);

    // Each turn stages what the turn before has loaded, loads the next turn's, and multiplies.
    vec4 nextA[kQuads], nextB[kQuads];
    const uint turns = (end - begin + kDepth - 1) / kDepth;
    for (uint turn = 0; turn <= turns; ++turn) {
        uint k = begin + turn * kDepth;
        if (turn > 0) {
            // Steps behind the end have the last one of B again, times a zero of A.
            [[unroll]] for (uint i = 0; i < kQuads; ++i) {
                stagedA[ofA[i].y * kPitch + ofA[i].x] =
                    k - kDepth + ofA[i].y < end ? nextA[i] : vec4(0);
                stagedB[ofB[i].y * kPitch + ofB[i].x] = nextB[i];
            }
            barrier();
        }
        if (turn < turns) {
            [[unroll]] for (uint i = 0; i < kQuads; ++i) {
                nextA[i] = loadA(startA[i] + min(k + ofA[i].y, end - 1) * strideA);
                nextB[i] = loadB(startB[i] + min(k + ofB[i].y, end - 1) * strideB);
            }
        }
        if (turn > 0) {
            for (uint s = 0; s < kDepth; ++s) {
                vec4 left[kRowQuads], right[kColumnQuads];
                [[unroll]] for (uint q = 0; q < kRowQuads; ++q)
                    left[q] = stagedA[s * kPitch + q * (kSide / 8) + down];
                [[unroll]] for (uint q = 0; q < kColumnQuads; ++q)
                    right[q] = stagedB[s * kPitch + q * kAcross + across];
                [[unroll]] for (uint i = 0; i < 4 * kRowQuads; ++i)
                    [[unroll]] for (uint j = 0; j < kColumnQuads; ++j)
                        sum[i][j] += left[i / 4][i % 4] * right[j];
            }
            barrier();
        }
    }

    float scale = 1;
    if (has(kGemmScaled)) scale = 1 / halfScale(largest.d[0]);
    uint baseC =
        params.startC + part * params.batch * params.m * params.n + matrix * params.strideC;
    [[unroll]] for (uint i = 0; i < 4 * kRowQuads; ++i) {
        uint row = tileRow + i / 4 * (kSide / 2) + down * 4 + i % 4;
        if (row >= m) continue;
        [[unroll]] for (uint j = 0; j < kColumnQuads; ++j) {
            uint column = tileColumn + j * 4 * kAcross + across * 4;
            uint at = baseC + row * params.ldc + column;
            if (column >= n) continue;
            vec4 v = sum[i][j] * scale;
            if (has(kGemmBiasOfColumns))
                [[unroll]] for (uint e = 0; e < 4; ++e) v[e] += bias.d[min(column + e, n - 1)];
            if (has(kGemmBiasOfRows)) v += bias.d[row];
            if (has(kGemmAccumulates)) {
                if (has(kGemmQuadsC)) v += cQuads.d[at / 4];
                else
                    [[unroll]] for (uint e = 0; e < 4; ++e)
                        if (column + e < n) v[e] += c.d[at + e];
            }
            if (has(kGemmClamps)) v = max(v, vec4(0));
            if (has(kGemmClampsAtSix)) v = min(v, vec4(6));
            if (has(kGemmQuadsC)) cQuads.d[at / 4] = v;
            else
                [[unroll]] for (uint e = 0; e < 4; ++e)
                    if (column + e < n) c.d[at + e] = v[e];
        }
    }
}
