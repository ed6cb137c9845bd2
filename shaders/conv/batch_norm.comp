#version 460
// Ioffe and Szegedy, Batch Normalization, ICML 2015.
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(BatchNormParams, 5)
BUFFER(0, readonly, float, sums);              // [channels, threads], see batch_norm_image
BUFFER(1, readwrite, float, mean);             // [channels]
BUFFER(2, readwrite, float, deviation);        // [channels], 1 / sqrt(variance + epsilon)
BUFFER(3, readwrite, float, runningMean);      // [channels]
BUFFER(4, readwrite, float, runningVariance);  // [channels], unbiased

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
