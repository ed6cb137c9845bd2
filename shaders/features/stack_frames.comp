#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "features/params.h"
// What a window in time sees of every pixel, as channels, with a border of zeros: a convolution of
// these images is one of the video.
PARAMS(StackFramesParams, 2)
BUFFER(0, readonly, float, x);   // [frames, channels, height, width]
BUFFER(1, writeonly, float, y);  // [outFrames, channels, kernelT, outHeight, outWidth]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint column = i % params.outWidth - params.paddingW;
    uint row = i / params.outWidth % params.outHeight - params.paddingH;
    uint rest = i / (params.outWidth * params.outHeight);
    uint k = rest % params.kernelT, channel = rest / params.kernelT % params.channels;
    uint t = rest / (params.kernelT * params.channels) * params.strideT + k - params.paddingT;
    // Negative positions wrap to large ones, so one comparison finds both sides.
    bool inside = t < params.frames && row < params.height && column < params.width;
    uint from = ((t * params.channels + channel) * params.height + row) * params.width + column;
    y.d[i] = inside ? x.d[from] : 0;
}
