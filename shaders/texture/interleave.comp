// Planes [C,H,W] as a picture with its channels side by side, y[p, c] = x[c, p]; backward is the
// transpose, dx[c, p] = dy[p, c].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "texture/params.h"
PARAMS(InterleaveParams, 2)
BUFFER(0, readonly, float, x);       // [C,H,W]; backward: dy [H,W,C]
BUFFER(1, writeonly, float, y);      // [H,W,C]; backward: dx [C,H,W]

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
