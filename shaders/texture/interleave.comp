// Planes [C,H,W] as a picture with its channels side by side, y[p, c] = x[c, p]; backward is the
// transpose, dx[c, p] = dy[p, c].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "texture/params.h"
PARAMS(InterleaveParams, 4)
BUFFER(0, readonly, float, x);       // [C,H,W]; backward: dy [H,W,C]
BUFFER(1, writeonly, float, y);      // [H,W,C]; backward: dx [C,H,W]
BUFFER(2, readonly, uint64_t, xs);   // the same, in pairs
BUFFER(3, writeonly, uint64_t, ys);

// One invocation per pixel: there is no division to find it.
ENTRY(forward) {
    uint pixel = linearIndex(), channels = params.channels;
    if (pixel >= params.pixels) return;
    for (uint c = 0; c < channels; ++c) y.d[pixel * channels + c] = x.d[c * params.pixels + pixel];
}

ENTRY(backward) {
    uint pixel = linearIndex(), channels = params.channels;
    if (pixel >= params.pixels) return;
    for (uint c = 0; c < channels; ++c) y.d[c * params.pixels + pixel] = x.d[pixel * channels + c];
}

// Three channels, an even number of pixels: two of them per invocation.
ENTRY(forward_pairs) {
    uint i = linearIndex(), plane = params.pixels / 2;
    if (i >= plane) return;
    vec2 r = unpackPair(xs.d[i]), g = unpackPair(xs.d[plane + i]);
    vec2 b = unpackPair(xs.d[2 * plane + i]);
    ys.d[3 * i] = packPair(vec2(r.x, g.x));
    ys.d[3 * i + 1] = packPair(vec2(b.x, r.y));
    ys.d[3 * i + 2] = packPair(vec2(g.y, b.y));
}

ENTRY(backward_pairs) {
    uint i = linearIndex(), plane = params.pixels / 2;
    if (i >= plane) return;
    vec2 first = unpackPair(xs.d[3 * i]), second = unpackPair(xs.d[3 * i + 1]);
    vec2 third = unpackPair(xs.d[3 * i + 2]);
    ys.d[i] = packPair(vec2(first.x, second.y));
    ys.d[plane + i] = packPair(vec2(first.y, third.x));
    ys.d[2 * plane + i] = packPair(vec2(second.x, third.y));
}
