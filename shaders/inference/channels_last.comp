// The channels of each pixel side by side, as TensorFlow stores images [H,W,C]:
// y[p,c] = x[c,p].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "inference/params.h"
PARAMS(ChannelsLastParams, 2)
BUFFER(0, readonly, float, x);   // [C, pixels]
BUFFER(1, writeonly, float, y);  // [pixels, C]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint pixel = quotient(i, params.byChannels), channel = remainder(i, pixel, params.byChannels);
    y.d[i] = x.d[channel * params.pixels + pixel];
}
