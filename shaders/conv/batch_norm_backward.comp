#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(BatchNormParams, 10)
BUFFER(0, readonly, float, x);            // [images, channels, pixels]
BUFFER(1, readonly, float, dy);           // [images, channels, pixels]
BUFFER(2, readonly, float, mean);         // [channels]
BUFFER(3, readonly, float, deviation);    // [channels], 1 / sqrt(variance + epsilon)
BUFFER(4, writeonly, float, partial);     // [2, channels, threads]
BUFFER(5, readonly, float, sums);         // [2, channels, threads], what partial was
BUFFER(6, readonly, float, weight);       // [channels]
BUFFER(7, readwrite, float, dweight);     // [channels]
BUFFER(8, readwrite, float, dbias);       // [channels]
BUFFER(9, writeonly, float, dx);          // [images, channels, pixels]

layout(constant_id = 1) const bool kTraining = true;  // mean and deviation are x's own

// As batch_norm.sum: of dy and of dy times the normalised x.
ENTRY(sum) {
    uint t = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint channel = gl_WorkGroupID.y, pixels = params.pixels, threads = params.threads;
    if (t >= threads) return;
    uint channels = params.channels, images = params.images;
    float middle = mean.d[channel], scale = deviation.d[channel], total = 0, product = 0;
    for (uint n = 0; n < images; ++n) {
        uint plane = (n * channels + channel) * pixels;
        for (uint p = t; p < pixels; p += threads) {
            float g = dy.d[plane + p];
            total += g;
            product += g * ((x.d[plane + p] - middle) * scale);
        }
    }
    partial.d[channel * threads + t] = total;
    partial.d[(channels + channel) * threads + t] = product;
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

// Workgroups: x pixels, y channels, z images.
ENTRY(input) {
    uint p = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint c = gl_WorkGroupID.y;
    if (p >= params.pixels) return;
    uint i = (gl_WorkGroupID.z * params.channels + c) * params.pixels + p;
    float scale = deviation.d[c], g = dy.d[i];
    if (kTraining) {
        float count = params.images * params.pixels;
        float normalised = (x.d[i] - mean.d[c]) * scale;
        g -= (dbias.d[c] + normalised * dweight.d[c]) / count;
    }
    dx.d[i] = weight.d[c] * scale * g;
}
