// What batch normalisation keeps of each channel, finished from the sums of batch_norm_passes.comp
// or batch_norm_blocks.comp: mean, deviation = 1 / sqrt(variance + epsilon), the running statistics
//     running = (1 - momentum) running + momentum (mean, or variance without bias),
// and the gradients of weight and bias. Ioffe and Szegedy, Batch Normalization, ICML 2015.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "conv/params.h"
PARAMS(BatchNormParams, 8)
BUFFER(0, readonly, float, sums);              // [channels, threads]; of gradients [2, …]
BUFFER(1, readwrite, float, mean);             // [channels]
BUFFER(2, readwrite, float, deviation);        // [channels]
BUFFER(3, readwrite, float, runningMean);      // [channels]
BUFFER(4, readwrite, float, runningVariance);  // [channels], unbiased
BUFFER(5, writeonly, float, dweight);          // [channels]
BUFFER(6, writeonly, float, dbias);            // [channels]
BUFFER(7, readonly, Pair, chunkSums);          // [channels, threads], of batch_norm_blocks.comp

layout(constant_id = 1) const bool kRunning = false;  // update the running statistics

float channelSum(uint channel) {
    float total = 0;
    uint threads = params.threads, at = channel * threads;
    for (uint t = 0; t < threads; ++t) total += sums.d[at + t];
    return total;
}

ENTRY(mean) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    float m = channelSum(c) / (params.images * params.pixels);
    mean.d[c] = m;
    if (kRunning)
        runningMean.d[c] = (1 - params.momentum) * runningMean.d[c] + params.momentum * m;
}

ENTRY(deviation) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    uint count = params.images * params.pixels;
    float squares = channelSum(c);
    deviation.d[c] = 1 / sqrt(squares / count + params.epsilon);
    if (kRunning)
        runningVariance.d[c] = (1 - params.momentum) * runningVariance.d[c] +
                               params.momentum * squares / max(count - 1, 1);
}

// In evaluation.
ENTRY(running) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    mean.d[c] = runningMean.d[c];
    deviation.d[c] = 1 / sqrt(runningVariance.d[c] + params.epsilon);
}

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

// Chan, Golub and LeVeque, Updating Formulae and a Pairwise Algorithm for Computing Sample
// Variances (1979), for chunks of one size.
CPU_ENTRY(chunk_statistics) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    uint threads = params.threads, at = c * threads, all = params.images * params.pixels;
    float total = 0, squares = 0;
    for (uint t = 0; t < threads; ++t) total += unpackPair(chunkSums.d[at + t]).x;
    float middle = total / all;
    for (uint t = 0; t < threads; ++t) {
        vec2 chunk = unpackPair(chunkSums.d[at + t]);
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

CPU_ENTRY(chunk_parameters) {
    uint c = linearIndex();
    if (c >= params.channels) return;
    uint threads = params.threads, at = c * threads;
    vec2 total = vec2(0);
    for (uint t = 0; t < threads; ++t) total += unpackPair(chunkSums.d[at + t]);
    dbias.d[c] = total.x;
    dweight.d[c] = total.y;
}
