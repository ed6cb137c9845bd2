#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(SumParams, 2)
BUFFER(0, readonly, float, x);   // [n]
BUFFER(1, writeonly, float, y);  // [ceil(n / kSumChunk)]

ENTRY(chunks) {
    uint i = linearIndex();
    uint begin = i * kSumChunk, end = min(params.n, begin + kSumChunk);
    if (begin >= params.n && i > 0) return;  // the sum of nothing is a number too
    float sum = 0;
    for (uint k = begin; k < end; ++k) sum += x.d[k];
    y.d[i] = params.scale * sum;
}
