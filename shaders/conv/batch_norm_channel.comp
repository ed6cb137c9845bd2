// Batch normalisation of small images in one dispatch each way, for CPUs: a workgroup, which is one
// subgroup, takes a channel through all passes while it is in the core's cache. The passes and
// formulas are those of batch_norm_passes.comp.
// y = f(weight (x - mean) / sqrt(variance + epsilon) + bias), [images, channels, pixels].
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common/op.glsl"
#include "conv/params.h"
#include "conv/batch_norm.glsl"
PARAMS(BatchNormParams, 11)
BUFFER(0, readonly, Element, x);               // [images, channels, pixels]
BUFFER(1, readonly, Element, dy);              // [images, channels, pixels]
BUFFER(2, writeonly, Element, y);              // [images, channels, pixels]; backward: dx
BUFFER(3, readwrite, float, mean);             // [channels]
BUFFER(4, readwrite, float, deviation);        // [channels], 1 / sqrt(variance + epsilon)
BUFFER(5, readonly, float, weight);            // [channels]
BUFFER(6, readonly, float, bias);              // [channels]
BUFFER(7, readwrite, float, runningMean);      // [channels]
BUFFER(8, readwrite, float, runningVariance);  // [channels], unbiased
BUFFER(9, writeonly, float, dweight);          // [channels]
BUFFER(10, writeonly, float, dbias);           // [channels]

layout(constant_id = 1) const bool kRunning = false;  // update the running statistics
layout(constant_id = 2) const bool kTraining = true;  // mean and deviation are x's own
layout(constant_id = 3) const uint kLanes = 8;

const uint kEach = 4;  // elements in the body of a loop

// Sums over the channel's elements. Lanes behind an image's last element read it again, and add
// nothing.
float sumOfChannel(uint c, float middle, bool squares) {
    uint count = params.pixels / WIDTH, lane = gl_SubgroupInvocationID;
    Value total = Value(0);
    for (uint n = 0; n < params.images; ++n) {
        uint plane = (n * params.channels + c) * count;
        for (uint first = 0; first < count; first += kEach * kLanes) {
            [[unroll]] for (uint e = 0; e < kEach; ++e) {
                uint p = first + e * kLanes + lane;
                Value v = value(x.d[plane + min(p, count - 1)]) - middle;
                if (squares) v *= v;
                total += p < count ? v : Value(0);
            }
        }
    }
    return subgroupAdd(horizontal(total));
}

// Workgroups: x channels.
ENTRY(forward) {
    uint c = gl_WorkGroupID.x, lane = gl_SubgroupInvocationID;
    uint count = params.pixels / WIDTH, all = params.images * params.pixels;
    float slope = params.slope, w = weight.d[c], shift = bias.d[c];
    float middle = sumOfChannel(c, 0, false) / all;
    float squares = sumOfChannel(c, middle, true);
    float inverse = 1 / sqrt(squares / all + params.epsilon), scale = inverse * w;
    for (uint n = 0; n < params.images; ++n) {
        uint plane = (n * params.channels + c) * count;
        for (uint first = 0; first < count; first += kEach * kLanes) {
            [[unroll]] for (uint e = 0; e < kEach; ++e) {
                uint p = first + e * kLanes + lane;
                if (p < count) {
                    Value v = (value(x.d[plane + p]) - middle) * scale + shift;
                    y.d[plane + p] = element(rectified(v, v, slope));
                }
            }
        }
    }
    if (lane > 0) return;
    mean.d[c] = middle;
    deviation.d[c] = inverse;
    if (kRunning) {
        float momentum = params.momentum, old = 1 - momentum;
        runningMean.d[c] = old * runningMean.d[c] + momentum * middle;
        runningVariance.d[c] =
            old * runningVariance.d[c] + momentum * squares / max(all - 1, 1);
    }
}

ENTRY(backward) {
    uint c = gl_WorkGroupID.x, lane = gl_SubgroupInvocationID;
    uint count = params.pixels / WIDTH;
    float middle = mean.d[c], scale = deviation.d[c], slope = params.slope;
    float w = weight.d[c], shift = bias.d[c];
    Value total = Value(0), product = Value(0);
    for (uint n = 0; n < params.images; ++n) {
        uint plane = (n * params.channels + c) * count;
        for (uint first = 0; first < count; first += kEach * kLanes) {
            [[unroll]] for (uint e = 0; e < kEach; ++e) {
                uint p = first + e * kLanes + lane, at = plane + min(p, count - 1);
                Value normalised = (value(x.d[at]) - middle) * scale;
                Value g = rectified(value(dy.d[at]), normalised * w + shift, slope);
                g = p < count ? g : Value(0);
                total += g;
                product += g * normalised;
            }
        }
    }
    float sum = subgroupAdd(horizontal(total)), sumOfProducts = subgroupAdd(horizontal(product));
    if (lane == 0) {
        dbias.d[c] = sum;
        dweight.d[c] = sumOfProducts;
    }
    float all = 1.0 / (params.images * params.pixels);
    float meanG = kTraining ? sum * all : 0, meanProduct = kTraining ? sumOfProducts * all : 0;
    for (uint n = 0; n < params.images; ++n) {
        uint plane = (n * params.channels + c) * count;
        for (uint first = 0; first < count; first += kEach * kLanes) {
            [[unroll]] for (uint e = 0; e < kEach; ++e) {
                uint p = first + e * kLanes + lane;
                if (p < count) {
                    Value normalised = (value(x.d[plane + p]) - middle) * scale;
                    Value g = rectified(value(dy.d[plane + p]), normalised * w + shift, slope);
                    g -= meanG + normalised * meanProduct;
                    y.d[plane + p] = element(w * scale * g);
                }
            }
        }
    }
}
