// C = the sum of the parts into which a product's sums over k were cut (gemm.comp) (+ bias) (+ C),
// or the positive part of it; the parts in order, for the same bits every run.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "linalg/params.h"
PARAMS(GemmReduceParams, 3)
BUFFER(0, readonly, float, partial);  // [parts, batch, m, n]
BUFFER(1, readwrite, float, c);       // [batch, m, n], with strides
BUFFER(2, readonly, float, bias);     // [n] or [m]

layout(constant_id = 1) const bool kAccumulate = false;
layout(constant_id = 2) const uint kBias = 0;  // 1: one per column, 2: one per row
layout(constant_id = 3) const bool kRelu = false;

ENTRY(sum) {
    uint i = linearIndex();
    if (i >= params.elements) return;
    uint rows = quotient(i, params.byColumns), column = remainder(i, rows, params.byColumns);
    uint matrix = quotient(rows, params.byRows), row = remainder(rows, matrix, params.byRows);
    uint at = params.startC + matrix * params.strideC + row * params.ldc + column;
    float total = 0;
    for (uint p = 0; p < params.parts; ++p) total += partial.d[p * params.elements + i];
    if (kBias == 1) total += bias.d[column];
    if (kBias == 2) total += bias.d[row];
    if (kAccumulate) total += c.d[at];
    c.d[at] = kRelu ? max(total, 0) : total;
}
