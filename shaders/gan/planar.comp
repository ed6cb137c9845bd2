// A picture with its channels side by side, [H,W,C], as planes [C,H,W], weighted by a mask [H,W]:
// y[c, p] = mask[p] image[p, c], 0 where the mask is, whatever the picture holds there. Backward:
// dImage[p, c] = mask[p] dy[c, p].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "gan/params.h"
PARAMS(PlanarParams, 10)
BUFFER(0, readonly, float, image);         // [H,W,C]
BUFFER(1, readonly, float, mask);          // [H,W]
BUFFER(2, writeonly, float, y);            // [C,H,W]
BUFFER(3, readonly, float, dy);            // [C,H,W]
BUFFER(4, writeonly, float, dImage);       // [H,W,C]
BUFFER(5, readonly, uint64_t, images);     // the same, in pairs
BUFFER(6, readonly, uint64_t, masks);
BUFFER(7, writeonly, uint64_t, ys);
BUFFER(8, readonly, uint64_t, dys);
BUFFER(9, writeonly, uint64_t, dImages);

layout(constant_id = 1) const bool kMasked = false;

// What the mask leaves out may be anything, a NaN too.
float masked(float m, float v) { return m == 0 ? 0 : m * v; }
vec2 masked(vec2 m, vec2 v) { return vec2(masked(m.x, v.x), masked(m.y, v.y)); }

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

// Three channels, an even number of pixels: two of them per invocation.
ENTRY(forward_pairs) {
    uint i = linearIndex(), plane = params.pixels / 2;
    if (i >= plane) return;
    vec2 m = kMasked ? unpackPair(masks.d[i]) : vec2(1);
    vec2 first = unpackPair(images.d[3 * i]), second = unpackPair(images.d[3 * i + 1]);
    vec2 third = unpackPair(images.d[3 * i + 2]);
    ys.d[i] = packPair(masked(m, vec2(first.x, second.y)));
    ys.d[plane + i] = packPair(masked(m, vec2(first.y, third.x)));
    ys.d[2 * plane + i] = packPair(masked(m, vec2(second.x, third.y)));
}

ENTRY(backward_pairs) {
    uint i = linearIndex(), plane = params.pixels / 2;
    if (i >= plane) return;
    vec2 m = kMasked ? unpackPair(masks.d[i]) : vec2(1);
    vec2 r = masked(m, unpackPair(dys.d[i])), g = masked(m, unpackPair(dys.d[plane + i]));
    vec2 b = masked(m, unpackPair(dys.d[2 * plane + i]));
    dImages.d[3 * i] = packPair(vec2(r.x, g.x));
    dImages.d[3 * i + 1] = packPair(vec2(b.x, r.y));
    dImages.d[3 * i + 2] = packPair(vec2(g.y, b.y));
}
