// Blocks of 2x2 pixels from four groups of channels, as TensorFlow's DEPTH_TO_SPACE has them:
// y[c, 2 h + i, 2 w + j] = x[(2 i + j) C + c, h, w].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "inference/params.h"
PARAMS(DepthToSpaceParams, 2)
BUFFER(0, readonly, float, x);   // [4C,H,W]
BUFFER(1, writeonly, float, y);  // [C,2H,2W]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint rest = quotient(i, params.byColumns), column = remainder(i, rest, params.byColumns);
    uint channel = quotient(rest, params.byRows), row = remainder(rest, channel, params.byRows);
    uint from = (2 * (row % 2) + column % 2) * params.channels + channel;
    y.d[i] = x.d[(from * params.height + row / 2) * params.width + column / 2];
}
