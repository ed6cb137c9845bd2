// C = op(A) op(B) (+ bias) (+ C), or that clamped (kClamp), on CPUs; A is [m, k], B [k, n], batches
// of them. On a GPU gemm_staged.comp computes the same sums.
//
// A workgroup makes a tile of kRows rows; each lane sums 2 kPairs columns of it in registers:
// columns 2 (lane + lanes j) and the next, for j < kPairs. A and B are read as they lie, transposed
// or in panels (common/panels.h). Sums over k may be cut into parts, which gemm_reduce.comp adds
// up.
//
// A load costs some sixteen multiply-adds for four values of a lane, and no less when all lanes want
// the same address: values are loaded in fours where they lie so, each value of A by one lane only,
// and handed out by subgroupBroadcast.
#version 460
// VARIANTS: cpu
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/panels.h"
#include "common/rows.h"
#include "linalg/half_scale.glsl"
#include "linalg/params.h"
PARAMS(GemmParams, 9)
BUFFER(0, readonly, float, a);      // [batch, m, k] as kLayoutA says
BUFFER(1, readonly, float, b);      // [batch, k, n] as kLayoutB says
BUFFER(2, readwrite, float, c);     // [parts, batch, m, n]
BUFFER(3, readonly, float, bias);   // [n] or [m], see kBias
BUFFER(4, readonly, uint, largest); // [1], see kScaled
QUADS(5, aQuads);                   // a again
QUADS(6, bQuads);                   // b again
BUFFER(7, readwrite, Pair, cPairs); // c again
BUFFER(8, readonly, uint, listed);  // rows, see kListed

layout(constant_id = 1) const uint kRows = 8;  // a multiple of 8
layout(constant_id = 2) const uint kPairs = 2;
layout(constant_id = 3) const uint kLayoutA = 0;  // rows, transposed or row panels
layout(constant_id = 4) const uint kLayoutB = 0;  // rows, transposed, column panels, interleaved
layout(constant_id = 5) const bool kAccumulate = false;
layout(constant_id = 6) const uint kBias = 0;  // 1: one per column, 2: one per row
// Whether texels of A and B start at elements divisible by four and none is cut by the end of k
// (kTransB); whether pairs of C start at even ones and none is cut by the matrix's end.
layout(constant_id = 7) const bool kQuadA = false;
layout(constant_id = 8) const bool kQuadB = false;
layout(constant_id = 9) const bool kEvenC = false;
layout(constant_id = 10) const uint kLanes = 8;
layout(constant_id = 11) const uint kClamp = 0;  // 1: to positive numbers, 2: to [0, 6]
// A and B are panels of halves, two to a word; A or B was multiplied by halfScale(largest).
layout(constant_id = 12) const bool kHalves = false;
layout(constant_id = 13) const bool kScaled = false;
// A's panels have not all rows, but those that a list names (common/rows.glsl).
layout(constant_id = 14) const bool kListed = false;
// Whether tiles are full: without a branch per row a kernel compiles in half the time on lavapipe.
// So where C is only written, rows behind the last go to the last one's place before it.
layout(constant_id = 15) const bool kWholeRows = false;
layout(constant_id = 16) const bool kWholeColumns = false;

// Steps of k in the loop's body: a loop's sums pass through masks on lavapipe at every turn. Of
// these, how many are multiplied while a row's sums stay in registers.
const uint kUnroll = kGemmUnroll, kSteps = 4;
const bool kTransA = kLayoutA != kLayoutRows;
const bool kTransB = kLayoutB == kLayoutTransposed;
const bool kPanelsB = kLayoutB == kLayoutColumnPanels || kLayoutB == kLayoutInterleaved;

// A[row, k], zero from end on.
float loadA(uint base, uint row, uint k, uint end) {
    if (kLayoutA == kLayoutRowPanels) {  // zero behind the end as they are
        uint at = base + placeInPanel(row, k, kRows);
        if (!kHalves) return a.d[at];
        vec2 pair = unpackHalf2x16(floatBitsToUint(a.d[at / 2]));
        return at % 2 == 0 ? pair.x : pair.y;
    }
    uint r = min(row, params.m - 1), s = min(k, end - 1);
    float v = a.d[base + (kTransA ? s * params.lda + r : r * params.lda + s)];
    return k < end ? v : 0;
}

// Four values of A. kTransA: of rows row to row + 3 at step k; else of steps k to k + 3. Rows
// behind the last are anything.
const uint kLoadsA = kRows * kUnroll / 4 / kLanes;  // per lane and body of the loop
vec4 loadQuadA(uint base, uint row, uint k, uint end) {
    if (!kQuadA) {
        vec4 v;
        [[unroll]] for (uint c = 0; c < 4; ++c)
            v[c] = kTransA ? loadA(base, row + c, k, end) : loadA(base, row, k + c, end);
        return v;
    }
    if (kLayoutA == kLayoutRowPanels)
        return quadAt(aQuads, (base + placeInPanel(row, k, kRows)) / 4);
    if (kTransA) {
        vec4 v = quadAt(aQuads, (base + min(k, end - 1) * params.lda + row) / 4);
        return k < end ? v : vec4(0);
    }
    vec4 v = quadAt(aQuads, (base + min(row, params.m - 1) * params.lda + k) / 4);
    return mix(vec4(0), v, lessThan(uvec4(k, k + 1, k + 2, k + 3), uvec4(end)));
}

uint elementA(uint i, uint u) {  // of the body's quads, where row i's step u is
    return kTransA ? u * (kRows / 4) + i / 4 : (u / 4) * kRows + i;
}

// Two neighbours in a row of B, or, second being anywhere, two elements.
vec2 loadB(uint first, uint second) {
    if (kHalves) return unpackHalf2x16(floatBitsToUint(b.d[first / 2]));
    return vec2(b.d[first], b.d[second]);
}

ENTRY(tile) {
    uint lane = gl_SubgroupInvocationID;
    uint m = params.m, n = params.n, ldb = params.ldb;
    uint tile = gl_WorkGroupID.x;
    uint tileRow = tile * kRows, tileColumn = gl_WorkGroupID.y * 2 * kPairs * kLanes;
    uint part = gl_WorkGroupID.z / params.batch, matrix = gl_WorkGroupID.z % params.batch;
    uint baseA = params.startA + matrix * params.strideA;
    uint baseB = params.startB + matrix * params.strideB;
    uint begin = part * params.kPart, end = min(params.k, begin + params.kPart);
    uint row = tileRow;  // of A, from baseA
    if (kLayoutA == kLayoutRowPanels) {
        baseA += tile * params.lda;
        row = 0;
    }

    vec2 sum[kRows][kPairs];
    uint column[kPairs], startB[kPairs], nextB[kPairs];
    [[unroll]] for (uint j = 0; j < kPairs; ++j) {
        uint within = 2 * (lane * kPairs + j);
        column[j] = tileColumn + within;
        if (kLayoutB == kLayoutColumnPanels) {
            startB[j] = baseB + gl_WorkGroupID.y * params.ldb + within;
            nextB[j] = startB[j] + 1;
        } else {
            startB[j] = min(column[j], n - 1);
            nextB[j] = min(column[j] + 1, n - 1);
            startB[j] = baseB + (kTransB ? startB[j] * ldb : startB[j]);
            nextB[j] = baseB + (kTransB ? nextB[j] * ldb : nextB[j]);
        }
        [[unroll]] for (uint i = 0; i < kRows; ++i) sum[i][j] = vec2(0);
    }
    uint stepB = kPanelsB ? 2 * kPairs * kLanes : ldb;
    // Of B's rows and panels a lane has a texel's columns (kPairs = 2), or half of one's, or two
    // steps'.
    uint quadB = baseB + (kPanelsB ? gl_WorkGroupID.y * params.ldb : tileColumn) +
                 (kLayoutB == kLayoutInterleaved ? 4 : 2 * kPairs) * lane;
    bool upperHalf = quadB % 4 != 0;

    // Steps behind the end read the last one of B again, times a zero from A.
    for (uint k = begin; k < end; k += kUnroll) {
        vec4 quadsA[kLoadsA];
        [[unroll]] for (uint t = 0; t < kLoadsA; ++t) {
            uint e = t * kLanes + lane;
            quadsA[t] =
                kTransA ? loadQuadA(baseA, row + 4 * (e % (kRows / 4)), k + e / (kRows / 4), end)
                        : loadQuadA(baseA, row + e % kRows, k + 4 * (e / kRows), end);
        }
        [[unroll]] for (uint u = 0; u < kUnroll; u += kSteps) {
            vec2 ofB[kSteps][kPairs];
            if (kQuadB && kTransB) {
                uint at = min(k + u, end - 4);
                [[unroll]] for (uint j = 0; j < kPairs; ++j) {
                    vec4 left = quadAt(bQuads, (startB[j] + at) / 4);
                    vec4 right = quadAt(bQuads, (nextB[j] + at) / 4);
                    [[unroll]] for (uint s = 0; s < kSteps; ++s)
                        ofB[s][j] = vec2(left[s], right[s]);
                }
            } else if (kLayoutB == kLayoutInterleaved) {
                [[unroll]] for (uint s = 0; s < kSteps; s += 2) {
                    uint at = quadB + min(k + u + s, (end - 1) / 2 * 2) * stepB;
                    vec4 v = quadAt(bQuads, at / 4);
                    ofB[s][0] = v.xy;
                    ofB[s + 1][0] = v.zw;
                }
            } else if (kQuadB && kPairs <= 2) {
                [[unroll]] for (uint s = 0; s < kSteps; ++s) {
                    uint at = quadB + min(k + u + s, end - 1) * stepB;
                    vec4 v = quadAt(bQuads, at / 4);
                    if (kPairs == 1) {
                        ofB[s][0] = upperHalf ? v.zw : v.xy;
                    } else {
                        ofB[s][0] = v.xy;
                        ofB[s][kPairs - 1] = v.zw;
                    }
                }
            } else
            {
                [[unroll]] for (uint s = 0; s < kSteps; ++s) {
                    uint at = min(k + u + s, end - 1) * (kTransB ? 1 : stepB);
                    [[unroll]] for (uint j = 0; j < kPairs; ++j)
                        ofB[s][j] = loadB(startB[j] + at, nextB[j] + at);
                }
            }
            [[unroll]] for (uint i = 0; i < kRows; ++i) {
                [[unroll]] for (uint s = 0; s < kSteps; ++s) {
                    uint e = elementA(i, u + s);
                    float v = subgroupBroadcast(quadsA[e / kLanes][kTransA ? i % 4 : (u + s) % 4],
                                                e % kLanes);
                    [[unroll]] for (uint j = 0; j < kPairs; ++j) sum[i][j] += v * ofB[s][j];
                }
            }
        }
    }

    uint rowsListed[kRows / kRowsListed];
    if (kListed)
        [[unroll]] for (uint i = 0; i < kRows / kRowsListed; ++i)
            rowsListed[i] = listed.d[tile * (kRows / kRowsListed) + i] * kRowsListed;
    float scale = 1;
    if (kScaled) scale = 1 / halfScale(largest.d[0]);
    uint baseC =
        params.startC + part * params.batch * params.m * params.n + matrix * params.strideC;
    bool branch = !kWholeRows && (kAccumulate || kListed);
    [[unroll]] for (uint j = 0; j < kPairs; ++j) {
        if (!kWholeColumns && column[j] >= n) continue;
        bool both = kWholeColumns || column[j] + 1 < n;
        [[unroll]] for (uint before = 0; before < kRows; ++before) {
            uint i = kRows - 1 - before, r = tileRow + i;
            if (kListed) r = rowsListed[i / kRowsListed] + i % kRowsListed;
            if (!kWholeRows && !branch) r = min(r, m - 1);
            uint at = baseC + r * params.ldc + column[j];
            if (!branch || r < m) {
                vec2 v = sum[i][j];
                if (kScaled) v *= scale;
                if (kBias == 1) v += vec2(bias.d[column[j]], bias.d[min(column[j] + 1, n - 1)]);
                if (kBias == 2) v += bias.d[r];
                if (kEvenC) {
                    if (kAccumulate) v += unpackPair(cPairs.d[at / 2]);
                    if (kClamp > 0) v = max(v, vec2(0));
                    if (kClamp > 1) v = min(v, vec2(6));
                    cPairs.d[at / 2] = packPair(v);
                    continue;
                }
                if (kAccumulate) v += vec2(c.d[at], both ? c.d[at + 1] : 0);
                if (kClamp > 0) v = max(v, vec2(0));
                if (kClamp > 1) v = min(v, vec2(6));
                c.d[at] = v.x;
                if (both) c.d[at + 1] = v.y;
            }
        }
    }
}
