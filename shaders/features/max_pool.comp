// y = the greatest value that each window of kernel T x H x W sees of x, moved by strides in time
// and space; what lies outside does not count. No gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "features/params.h"
PARAMS(MaxPoolParams, 2)
BUFFER(0, readonly, float, x);   // [frames, channels, height, width]
BUFFER(1, writeonly, float, y);  // [outFrames, channels, outHeight, outWidth]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint ox = i % params.outWidth, oy = i / params.outWidth % params.outHeight;
    uint plane = i / (params.outWidth * params.outHeight);
    uint channel = plane % params.channels, ot = plane / params.channels;
    int t0 = int(ot * params.strideT) - int(params.paddingT);
    int y0 = int(oy * params.strideH) - int(params.paddingH);
    int x0 = int(ox * params.strideW) - int(params.paddingW);
    int t1 = min(t0 + int(params.kernelT), int(params.frames));
    int y1 = min(y0 + int(params.kernelH), int(params.height));
    int x1 = min(x0 + int(params.kernelW), int(params.width));
    float most = uintBitsToFloat(0xff800000u);  // minus infinity
    for (int t = max(t0, 0); t < t1; ++t)
        for (int row = max(y0, 0); row < y1; ++row)
            for (int column = max(x0, 0); column < x1; ++column)
                most = max(most, x.d[((t * params.channels + channel) * params.height + row) *
                                         params.width + column]);
    y.d[i] = most;
}
