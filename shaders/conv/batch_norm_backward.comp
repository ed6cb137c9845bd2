#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(BatchNormParams, 3)
BUFFER(0, readonly, float, sums);      // [2, channels, threads], see batch_norm.glsl
BUFFER(1, writeonly, float, dweight);  // [channels]
BUFFER(2, writeonly, float, dbias);    // [channels]

ENTRY(parameters) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    uint threads = params.threads, at = c * threads, second = params.channels * threads;
    float total = 0, product = 0;
    for (uint t = 0; t < threads; ++t) {
        total += sums.d[at + t];
        product += sums.d[second + at + t];
    }
    dbias.d[c] = total;
    dweight.d[c] = product;
}
