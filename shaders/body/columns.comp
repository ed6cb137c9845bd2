#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "body/params.h"
PARAMS(ColumnsParams, 2)
BUFFER(0, readonly, float, x);   // [rows,columns]
BUFFER(1, writeonly, float, y);  // [columns] sum, or [ceil(rows / kBodyChunk),columns] chunks

// Second stage of the reductions: partial sums of chunks to one row, always in the same order.
ENTRY(sum) {
    uint column = linearIndex();
    if (column >= params.columns) return;
    float sum = 0;
    for (uint row = 0; row < params.rows; ++row) sum += x.d[row * params.columns + column];
    y.d[column] = sum;
}

// First stage: one invocation per chunk of rows and column.
ENTRY(chunks) {
    uint i = linearIndex();
    uint chunk = i / params.columns, column = i % params.columns;
    uint begin = chunk * kBodyChunk, end = min(params.rows, begin + kBodyChunk);
    if (begin >= params.rows) return;
    float sum = 0;
    for (uint row = begin; row < end; ++row) sum += x.d[row * params.columns + column];
    y.d[i] = sum;
}
