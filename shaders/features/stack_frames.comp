// What a window in time sees of every pixel, as channels, with a border of zeros:
//     y[t, (c, k), row, column] = x[t strideT + k - paddingT, c, row - paddingH, column -
//     paddingW],
// so that a convolution of these images is one of the video. No gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "features/params.h"
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
