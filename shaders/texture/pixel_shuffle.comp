// Blocks of r x r pixels against channels (Shi et al., Real-Time Single Image and Video
// Super-Resolution Using an Efficient Sub-Pixel Convolutional Neural Network, CVPR 2016):
//     fine[n, c, r y + i, r x + j] = coarse[n, c r r + i r + j, y, x].
// coarse [N,C r r,H,W], fine [N,C,H r,W r]. Each way is the other's gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "texture/params.h"
PARAMS(PixelShuffleParams, 2)
BUFFER(0, readonly, float, x);
BUFFER(1, writeonly, float, y);

// Where the element i of `fine` is in `coarse`.
uint inCoarse(uint i) {
    uint r = params.block, line = params.width * r;
    uint row = i / line, column = i - row * line;                       // row: of all planes
    uint plane = row / (params.height * r), v = row - plane * params.height * r;
    uint channel = (plane * r + v % r) * r + column % r;
    return (channel * params.height + v / r) * params.width + column / r;
}

ENTRY(shuffle) {
    uint i = linearIndex();
    if (i < params.n) y.d[i] = x.d[inCoarse(i)];
}

ENTRY(unshuffle) {
    uint i = linearIndex();
    if (i < params.n) y.d[inCoarse(i)] = x.d[i];
}
