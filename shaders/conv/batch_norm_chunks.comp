#version 460
// Joins what batch_norm_blocks.comp found of each chunk.
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "conv/params.h"
PARAMS(BatchNormParams, 7)
BUFFER(0, readonly, uint64_t, sums);           // [channels, threads]
BUFFER(1, writeonly, float, mean);             // [channels]
BUFFER(2, writeonly, float, deviation);        // [channels], 1 / sqrt(variance + epsilon)
BUFFER(3, readwrite, float, runningMean);      // [channels]
BUFFER(4, readwrite, float, runningVariance);  // [channels], unbiased
BUFFER(5, writeonly, float, dweight);          // [channels]
BUFFER(6, writeonly, float, dbias);            // [channels]

layout(constant_id = 1) const bool kRunning = false;  // update the running statistics

// Chan, Golub and LeVeque, Updating Formulae and a Pairwise Algorithm for Computing Sample Variances
// (1979), for chunks of one size.
ENTRY(statistics) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    uint threads = params.threads, at = c * threads, all = params.images * params.pixels;
    float total = 0, squares = 0;
    for (uint t = 0; t < threads; ++t) total += unpackPair(sums.d[at + t]).x;
    float middle = total / all;
    for (uint t = 0; t < threads; ++t) {
        vec2 chunk = unpackPair(sums.d[at + t]);
        float apart = chunk.x / kChunkElements - middle;
        squares += chunk.y + kChunkElements * apart * apart;
    }
    mean.d[c] = middle;
    deviation.d[c] = 1 / sqrt(squares / all + params.epsilon);
    if (kRunning) {
        float momentum = params.momentum, old = 1 - momentum;
        runningMean.d[c] = old * runningMean.d[c] + momentum * middle;
        runningVariance.d[c] =
            old * runningVariance.d[c] + momentum * squares / max(all - 1, 1);
    }
}

ENTRY(parameters) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    uint threads = params.threads, at = c * threads;
    vec2 total = vec2(0);
    for (uint t = 0; t < threads; ++t) total += unpackPair(sums.d[at + t]);
    dbias.d[c] = total.x;
    dweight.d[c] = total.y;
}
