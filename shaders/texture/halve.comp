// The next level of a texture's pyramid, y = the mean of 2x2 texels:
//     y[h, w] = (x[2h, 2w] + x[2h, 2w+1] + x[2h+1, 2w] + x[2h+1, 2w+1]) / 4.
// Textures [H,W,C], H and W even.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "texture/params.h"
PARAMS(HalveParams, 2)
BUFFER(0, readonly, float, x);   // [H,W,C]; backward: dy [H/2,W/2,C]
BUFFER(1, writeonly, float, y);  // [H/2,W/2,C]; backward: dx [H,W,C]

// Where the first of the four texels of the element i of the smaller texture is in the larger one.
uint inLarger(uint i) {
    uint row = i / params.line, element = i - row * params.line;
    uint channel = element % params.channels;
    return 4 * row * params.line + 2 * element - channel;
}

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint above = inLarger(i), below = above + 2 * params.line, next = params.channels;
    y.d[i] = (x.d[above] + x.d[above + next] + (x.d[below] + x.d[below + next])) / 4;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint above = inLarger(i), below = above + 2 * params.line, next = params.channels;
    float share = x.d[i] / 4;
    y.d[above] = y.d[above + next] = y.d[below] = y.d[below + next] = share;
}
