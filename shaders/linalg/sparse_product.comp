// y = A x, A being kept as its numbers that are not zero, row by row (compressed sparse rows); the
// gradient dx = A^T dy is the same with the transposed matrix. One invocation per row.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "linalg/params.h"
PARAMS(SparseProductParams, 5)
BUFFER(0, readonly, int, begin);      // [rows+1]
BUFFER(1, readonly, ivec2, entries);  // [n] column, place in value
BUFFER(2, readonly, float, value);    // [n]
BUFFER(3, readonly, float, x);        // [columns,channels]
BUFFER(4, writeonly, float, y);       // [rows,channels]

ENTRY(forward) {
    uint row = linearIndex();
    if (row >= params.rows) return;
    int first = begin.d[row], last = begin.d[row + 1];
    for (uint c = 0; c < params.channels; ++c) {
        float sum = 0;
        for (int n = first; n < last; ++n)
            sum += value.d[entries.d[n].y] * x.d[params.channels * entries.d[n].x + c];
        y.d[params.channels * row + c] = sum;
    }
}
