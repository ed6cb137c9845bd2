// C = the sum of the parts into which a product's sums over k were cut (gemm.comp) (+ bias) (+ C),
// or that clamped (kClamp); the parts in order, for the same bits every run.
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
layout(constant_id = 3) const uint kClamp = 0;  // 1: to positive numbers, 2: to [0, 6]

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
    if (kClamp > 0) total = max(total, 0.0);
    if (kClamp > 1) total = min(total, 6.0);
    c.d[at] = total;
}
