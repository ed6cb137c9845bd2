#version 460
// Ioffe and Szegedy, Batch Normalization, ICML 2015.
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(BatchNormParams, 10)
BUFFER(0, readonly, float, x);          // [images, channels, pixels]
BUFFER(1, writeonly, float, partial);   // [channels, threads]
BUFFER(2, readonly, float, sums);       // [channels, threads], what partial was
BUFFER(3, readwrite, float, mean);      // [channels]
BUFFER(4, readwrite, float, deviation); // [channels], 1 / sqrt(variance + epsilon)
BUFFER(5, readwrite, float, runningMean);      // [channels]
BUFFER(6, readwrite, float, runningVariance);  // [channels], unbiased
BUFFER(7, readonly, float, weight);     // [channels]
BUFFER(8, readonly, float, bias);       // [channels]
BUFFER(9, writeonly, float, y);         // [images, channels, pixels]

layout(constant_id = 1) const bool kRunning = false;  // update the running statistics
layout(constant_id = 2) const bool kCentred = false;  // sum squares around the mean, not values

// Thread t of a channel sums its pixels t, t + threads, … of every image. Workgroups: y channels.
ENTRY(sum) {
    uint t = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint channel = gl_WorkGroupID.y, pixels = params.pixels, threads = params.threads;
    if (t >= threads) return;
    uint channels = params.channels, images = params.images;
    float middle = kCentred ? mean.d[channel] : 0, total = 0;
    for (uint n = 0; n < images; ++n) {
        uint plane = (n * channels + channel) * pixels;
        for (uint p = t; p < pixels; p += threads) {
            float v = x.d[plane + p] - middle;
            total += kCentred ? v * v : v;
        }
    }
    partial.d[channel * threads + t] = total;
}

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

// Workgroups: x pixels, y channels, z images.
ENTRY(forward) {
    uint p = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint c = gl_WorkGroupID.y;
    if (p >= params.pixels) return;
    uint i = (gl_WorkGroupID.z * params.channels + c) * params.pixels + p;
    float scale = deviation.d[c] * weight.d[c];
    y.d[i] = (x.d[i] - mean.d[c]) * scale + bias.d[c];
}
