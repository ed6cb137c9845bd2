// A picture with its channels side by side, [H,W,C], as planes [C,H,W], weighted by a mask [H,W]:
// y[c, p] = mask[p] image[p, c], 0 where the mask is, whatever the picture holds there. Backward:
// dImage[p, c] = mask[p] dy[c, p].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "gan/params.h"
PARAMS(PlanarParams, 5)
BUFFER(0, readonly, float, image);         // [H,W,C]
BUFFER(1, readonly, float, mask);          // [H,W]
BUFFER(2, writeonly, float, y);            // [C,H,W]
BUFFER(3, readonly, float, dy);            // [C,H,W]
BUFFER(4, writeonly, float, dImage);       // [H,W,C]

layout(constant_id = 1) const bool kMasked = false;

// What the mask leaves out may be anything, a NaN too.
float masked(float m, float v) { return m == 0 ? 0 : m * v; }

// One invocation per pixel: there is no division to find it.
ENTRY(forward) {
    uint pixel = linearIndex(), channels = params.channels;
    if (pixel >= params.pixels) return;
    float m = kMasked ? mask.d[pixel] : 1;
    for (uint c = 0; c < channels; ++c)
        y.d[c * params.pixels + pixel] = masked(m, image.d[pixel * channels + c]);
}

ENTRY(backward) {
    uint pixel = linearIndex(), channels = params.channels;
    if (pixel >= params.pixels) return;
    float m = kMasked ? mask.d[pixel] : 1;
    for (uint c = 0; c < channels; ++c)
        dImage.d[pixel * channels + c] = masked(m, dy.d[c * params.pixels + pixel]);
}
