#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "gan/params.h"
// A picture with its channels side by side as planes of one channel, weighted by a mask.
PARAMS(PlanarParams, 5)
BUFFER(0, readonly, float, image);    // [H,W,C]
BUFFER(1, readonly, float, mask);     // [H,W]
BUFFER(2, writeonly, float, y);       // [C,H,W]
BUFFER(3, readonly, float, dy);       // [C,H,W]
BUFFER(4, writeonly, float, dImage);  // [H,W,C]

layout(constant_id = 1) const bool kMasked = false;

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.channels * params.pixels) return;
    uint pixel = i % params.pixels, channel = i / params.pixels;
    float m = kMasked ? mask.d[pixel] : 1;
    y.d[i] = m == 0 ? 0 : m * image.d[pixel * params.channels + channel];
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.channels * params.pixels) return;
    uint pixel = i / params.channels, channel = i % params.channels;
    float m = kMasked ? mask.d[pixel] : 1;
    dImage.d[i] = m == 0 ? 0 : m * dy.d[channel * params.pixels + pixel];
}
