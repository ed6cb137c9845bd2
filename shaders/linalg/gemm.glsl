// C = op(A) op(B) (+ bias) (+ C), or the positive part of it. A workgroup makes a tile of kRows rows; each lane sums
// 2 kPairs columns of it in registers: columns 2 (lane + lanes j) and the next, for j < kPairs.
//
// Two builds. With PAIRS = 0 every lane reads the values of A that it needs (a GPU's cache
// broadcasts them). With PAIRS = 1, for drivers that run lanes as a CPU's vector: a load of one
// element per lane is a gather there, costs some thirty multiply-adds and no less when all lanes
// want the same address, but as much for eight bytes as for four. So values are loaded in pairs,
// each value of A by one lane only, and handed out by subgroupBroadcast.
//
// A and B are read as they lie, transposed, or in panels: what a tile needs of A (kRows rows) or B
// (its columns), step of k by step of k, without gaps. Rows that are a power of two apart fall into
// the same few lines of a CPU's cache; panels do not.
#include "linalg/half_scale.glsl"
#include "linalg/params.h"

#if PAIRS
#define BUFFERS 8
#define LARGEST 7
#else
#define BUFFERS 5
#define LARGEST 4
#endif
PARAMS(GemmParams, BUFFERS)
BUFFER(0, readonly, float, a);     // rows [batch, m, k]; transposed [batch, k, m]; panels
BUFFER(1, readonly, float, b);     // rows [batch, k, n]; transposed [batch, n, k]; panels
BUFFER(2, readwrite, float, c);    // [parts, batch, m, n]
BUFFER(3, readonly, float, bias);  // [n] or [m], see kBias
BUFFER(LARGEST, readonly, uint, largest);  // [1], see kScaled
#if PAIRS
BUFFER(4, readonly, uint64_t, aPairs);  // the same memory
BUFFER(5, readonly, uint64_t, bPairs);
BUFFER(6, readwrite, uint64_t, cPairs);
#endif

layout(constant_id = 1) const uint kRows = 8;  // a multiple of 8
layout(constant_id = 2) const uint kPairs = 2;
layout(constant_id = 3) const uint kLayoutA = 0;  // kGemmRows, kGemmTransposed, kGemmPanels
layout(constant_id = 4) const uint kLayoutB = 0;
layout(constant_id = 5) const bool kAccumulate = false;
layout(constant_id = 6) const uint kBias = 0;  // 1: one per column, 2: one per row
// Whether pairs of A, B, C start at even elements and none is cut by the matrix's end.
layout(constant_id = 7) const bool kEvenA = false;
layout(constant_id = 8) const bool kEvenB = false;
layout(constant_id = 9) const bool kEvenC = false;
layout(constant_id = 10) const uint kLanes = 8;
layout(constant_id = 11) const bool kRelu = false;
// A and B are panels of halves, two to a word; A or B was multiplied by halfScale(largest).
layout(constant_id = 12) const bool kHalves = false;
layout(constant_id = 13) const bool kScaled = false;

// Steps of k in the loop's body: a loop's sums pass through masks on lavapipe at every turn.
#if PAIRS
const uint kUnroll = kGemmUnroll;
#else
const uint kUnroll = 2;
#endif
const bool kTransA = kLayoutA != kGemmRows;        // pairs of A are neighbouring rows, not steps
const bool kTransB = kLayoutB == kGemmTransposed;  // pairs of B are neighbouring steps
const uint kLoadsA = kRows * kUnroll / 2 / kLanes;  // pairs per lane and body of the loop

#if PAIRS
vec2 unpackPair(uint64_t pair) { return uintBitsToFloat(unpackUint2x32(pair)); }
#endif

// A[row, k] and A[row, k + 1]; kTransA: A[row, k] and A[row + 1, k]. Zero from end on.
vec2 loadA(uint base, uint row, uint k, uint end) {
    if (kLayoutA == kGemmPanels) {  // zero behind the end as they are
        uint at = base + k * kRows + row;
        if (kHalves) {
            vec2 pair = unpackHalf2x16(floatBitsToUint(a.d[at / 2]));
            return at % 2 == 0 ? pair : pair.yx;  // rows from an odd one: only the first counts
        }
#if PAIRS
        return unpackPair(aPairs.d[at / 2]);
#else
        return vec2(a.d[at], a.d[at + 1]);
#endif
    }
    uint last = end - 1;
    uint first, second;
    if (kTransA) {
        first = base + min(k, last) * params.lda;
        second = first + min(row + 1, params.m - 1);
        first += min(row, kEvenA ? params.m - 2 : params.m - 1);
    } else {
        first = base + min(row, params.m - 1) * params.lda;
        second = first + min(k + 1, last);
        first += min(k, kEvenA ? end - 2 : last);
    }
#if PAIRS
    vec2 v = kEvenA ? unpackPair(aPairs.d[first / 2]) : vec2(a.d[first], a.d[second]);
#else
    vec2 v = vec2(a.d[first], a.d[second]);
#endif
    return vec2(k < end ? v.x : 0, (kTransA ? k : k + 1) < end ? v.y : 0);
}

// Two elements of B, second is the first's neighbour where kEvenB.
vec2 loadB(uint first, uint second) {
    if (kHalves) return unpackHalf2x16(floatBitsToUint(b.d[first / 2]));
#if PAIRS
    if (kEvenB) return unpackPair(bPairs.d[first / 2]);
#endif
    return vec2(b.d[first], b.d[second]);
}

void gemmTile() {
#if PAIRS
    uint lane = gl_SubgroupInvocationID;
#else
    uint lane = gl_LocalInvocationID.x;
#endif
    uint m = params.m, n = params.n, ldb = params.ldb;
    uint tileRow = gl_WorkGroupID.x * kRows, tileColumn = gl_WorkGroupID.y * 2 * kPairs * kLanes;
    uint part = gl_WorkGroupID.z / params.batch, matrix = gl_WorkGroupID.z % params.batch;
    uint baseA = params.startA + matrix * params.strideA;
    uint baseB = params.startB + matrix * params.strideB;
    uint begin = part * params.kPart, end = min(params.k, begin + params.kPart);
    uint row = tileRow;  // of A, from baseA
    if (kLayoutA == kGemmPanels) {
        baseA += gl_WorkGroupID.x * params.lda;
        row = 0;
    }

    vec2 sum[kRows][kPairs];
    uint column[kPairs], startB[kPairs], nextB[kPairs];
    [[unroll]] for (uint j = 0; j < kPairs; ++j) {
        uint within = 2 * (j * kLanes + lane);
        column[j] = tileColumn + within;
        if (kLayoutB == kGemmPanels) {
            startB[j] = baseB + gl_WorkGroupID.y * params.ldb + within;
            nextB[j] = startB[j] + 1;
        } else {
            startB[j] = min(column[j], kEvenB && !kTransB ? n - 2 : n - 1);
            nextB[j] = min(column[j] + 1, n - 1);
            startB[j] = baseB + (kTransB ? startB[j] * ldb : startB[j]);
            nextB[j] = baseB + (kTransB ? nextB[j] * ldb : nextB[j]);
        }
        [[unroll]] for (uint i = 0; i < kRows; ++i) sum[i][j] = vec2(0);
    }
    uint stepB = kLayoutB == kGemmPanels ? 2 * kPairs * kLanes : ldb;

    // Steps behind the end read the last one of B again, times a zero from A.
    for (uint k = begin; k < end; k += kUnroll) {
#if PAIRS
        vec2 pairA[kLoadsA];
        [[unroll]] for (uint t = 0; t < kLoadsA; ++t) {
            uint e = t * kLanes + lane;
            pairA[t] = kTransA ? loadA(baseA, row + 2 * (e % (kRows / 2)), k + e / (kRows / 2), end)
                               : loadA(baseA, row + e % kRows, k + 2 * (e / kRows), end);
        }
#endif
        [[unroll]] for (uint u = 0; u < kUnroll; u += 2) {
            vec2 b0[kPairs], b1[kPairs];  // steps k + u and k + u + 1
            uint k0 = min(k + u, end - 1), k1 = min(k + u + 1, end - 1);
            [[unroll]] for (uint j = 0; j < kPairs; ++j) {
                if (kTransB) {
                    if (kEvenB) k0 = min(k + u, end - 2);
                    vec2 left = loadB(startB[j] + k0, startB[j] + k1);
                    vec2 right = loadB(nextB[j] + k0, nextB[j] + k1);
                    b0[j] = vec2(left.x, right.x);
                    b1[j] = vec2(left.y, right.y);
                } else {
                    b0[j] = loadB(startB[j] + k0 * stepB, nextB[j] + k0 * stepB);
                    b1[j] = loadB(startB[j] + k1 * stepB, nextB[j] + k1 * stepB);
                }
            }
            [[unroll]] for (uint i = 0; i < kRows; ++i) {
#if PAIRS
                uint e0 = kTransA ? u * (kRows / 2) + i / 2 : (u / 2) * kRows + i;
                uint e1 = kTransA ? e0 + kRows / 2 : e0;
                vec2 p0 = pairA[e0 / kLanes], p1 = pairA[e1 / kLanes];
                float a0 = subgroupBroadcast(kTransA && (i & 1) == 1 ? p0.y : p0.x, e0 % kLanes);
                float a1 = subgroupBroadcast(kTransA && (i & 1) == 0 ? p1.x : p1.y, e1 % kLanes);
#else
                vec2 p = loadA(baseA, row + i, k + u, end);
                float a0 = p.x, a1 = kTransA ? loadA(baseA, row + i, k + u + 1, end).x : p.y;
#endif
                [[unroll]] for (uint j = 0; j < kPairs; ++j) {
                    sum[i][j] += a0 * b0[j];
                    sum[i][j] += a1 * b1[j];
                }
            }
        }
    }

    float scale = 1;
    if (kScaled) scale = 1 / halfScale(largest.d[0]);
    uint baseC = params.startC + part * params.strideCPart + matrix * params.strideC;
    [[unroll]] for (uint j = 0; j < kPairs; ++j) {
        if (column[j] >= n) continue;
        bool both = column[j] + 1 < n;
        [[unroll]] for (uint i = 0; i < kRows; ++i) {
            uint r = tileRow + i, at = baseC + r * params.ldc + column[j];
            if (r < m) {
                vec2 v = sum[i][j];
                if (kScaled) v *= scale;
                if (kBias == 1) v += vec2(bias.d[column[j]], bias.d[min(column[j] + 1, n - 1)]);
                if (kBias == 2) v += bias.d[r];
#if PAIRS
                if (kEvenC) {
                    if (kAccumulate) v += unpackPair(cPairs.d[at / 2]);
                    if (kRelu) v = max(v, vec2(0));
                    cPairs.d[at / 2] = packUint2x32(floatBitsToUint(v));
                    continue;
                }
#endif
                if (kAccumulate) v += vec2(c.d[at], both ? c.d[at + 1] : 0);
                if (kRelu) v = max(v, vec2(0));
                c.d[at] = v.x;
                if (both) c.d[at + 1] = v.y;
            }
        }
    }
}
