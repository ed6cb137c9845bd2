// The passes of batch normalisation over images [N,C,HW], Ioffe and Szegedy, Batch Normalization,
// ICML 2015, algorithm 1, with a leaky ReLU behind it (slope 1: none). With n = (x - mean)
// deviation,
//     y = f(weight n + bias),    g = dy f'(weight n + bias),    dbias = sum g,    dweight = sum g
//     n, dx = weight deviation (g - mean of g - n mean of (g n));
// in evaluation mean and deviation are constants: dx = weight deviation g. batch_norm.comp finishes
// the sums.
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "conv/params.h"
#include "conv/batch_norm.glsl"
PARAMS(BatchNormParams, 10)
BUFFER(0, readonly, Element, x);        // [images, channels, pixels]
BUFFER(1, writeonly, float, partial);   // [channels, threads], twice in backward
BUFFER(2, readonly, float, mean);       // [channels]
BUFFER(3, readonly, float, deviation);  // [channels], 1 / sqrt(variance + epsilon)
BUFFER(4, readonly, float, weight);     // [channels]
BUFFER(5, readonly, float, bias);       // [channels]
BUFFER(6, writeonly, Element, y);       // [images, channels, pixels]; backward: dx
BUFFER(7, readonly, Element, dy);       // [images, channels, pixels]
BUFFER(8, readonly, float, dweight);    // [channels]
BUFFER(9, readonly, float, dbias);      // [channels]

layout(constant_id = 1) const bool kCentred = false;  // sum squares around the mean, not values
layout(constant_id = 2) const bool kTraining = true;  // mean and deviation are x's own

const uint kEach = 4;  // elements of an invocation

// Thread t of a channel sums its elements t, t + threads, … of every image. Workgroups: y channels.
ENTRY(sum_values) {
    uint t = gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex();
    uint channel = gl_WorkGroupID.y, count = params.pixels / WIDTH, threads = params.threads;
    if (t >= threads) return;
    uint channels = params.channels, images = params.images;
    float middle = kCentred ? mean.d[channel] : 0;
    Value total = Value(0);
    for (uint n = 0; n < images; ++n) {
        uint plane = (n * channels + channel) * count;
        for (uint first = t; first < count; first += kEach * threads) {
            [[unroll]] for (uint e = 0; e < kEach; ++e) {
                uint p = first + e * threads;
                Value v = value(x.d[plane + min(p, count - 1)]) - middle;
                if (kCentred) v *= v;
                total += p < count ? v : Value(0);
            }
        }
    }
    partial.d[channel * threads + t] = horizontal(total);
}

// Workgroups: x elements, y channels, z images.
ENTRY(normalise) {
    uint count = params.pixels / WIDTH, c = gl_WorkGroupID.y;
    uint plane = (gl_WorkGroupID.z * params.channels + c) * count;
    float slope = params.slope, middle = mean.d[c], scale = deviation.d[c] * weight.d[c];
    float shift = bias.d[c];
    [[unroll]] for (uint e = 0; e < kEach; ++e) {
        uint p = (gl_WorkGroupID.x * kEach + e) * gl_WorkGroupSize.x + localIndex();
        if (p < count) {
            Value v = (value(x.d[plane + p]) - middle) * scale + shift;
            y.d[plane + p] = element(rectified(v, v, slope));
        }
    }
}

// As sum_values: of dy (before the leaky ReLU) and of it times the normalised x.
ENTRY(sum_gradients) {
    uint t = gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex();
    uint channel = gl_WorkGroupID.y, count = params.pixels / WIDTH, threads = params.threads;
    if (t >= threads) return;
    uint channels = params.channels, images = params.images;
    float middle = mean.d[channel], scale = deviation.d[channel], slope = params.slope;
    float w = weight.d[channel], shift = bias.d[channel];
    Value total = Value(0), product = Value(0);
    for (uint n = 0; n < images; ++n) {
        uint plane = (n * channels + channel) * count;
        for (uint first = t; first < count; first += kEach * threads) {
            [[unroll]] for (uint e = 0; e < kEach; ++e) {
                uint p = first + e * threads, at = plane + min(p, count - 1);
                Value normalised = (value(x.d[at]) - middle) * scale;
                Value g = rectified(value(dy.d[at]), normalised * w + shift, slope);
                g = p < count ? g : Value(0);
                total += g;
                product += g * normalised;
            }
        }
    }
    partial.d[channel * threads + t] = horizontal(total);
    partial.d[(channels + channel) * threads + t] = horizontal(product);
}

ENTRY(input_gradient) {
    uint count = params.pixels / WIDTH, c = gl_WorkGroupID.y;
    uint plane = (gl_WorkGroupID.z * params.channels + c) * count;
    float middle = mean.d[c], scale = deviation.d[c], slope = params.slope;
    float w = weight.d[c], shift = bias.d[c];
    float all = 1.0 / (params.images * params.pixels);
    float meanG = kTraining ? dbias.d[c] * all : 0,
          meanProduct = kTraining ? dweight.d[c] * all : 0;
    [[unroll]] for (uint e = 0; e < kEach; ++e) {
        uint p = (gl_WorkGroupID.x * kEach + e) * gl_WorkGroupSize.x + localIndex();
        if (p < count) {
            Value normalised = (value(x.d[plane + p]) - middle) * scale;
            Value g = rectified(value(dy.d[plane + p]), normalised * w + shift, slope);
            g -= meanG + normalised * meanProduct;
            y.d[plane + p] = element(w * scale * g);
        }
    }
}
