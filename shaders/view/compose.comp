// A part of a window's frame: a picture, or one colour, and the interface over it; four bytes a
// pixel, R, G, B, A:
//     frame = layer + (1 - layer's opacity) picture      (composed() in view/compose.h)
// and what the host has drawn anew of a picture, from a box [height,width] of its own.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "view/compose.h"
#include "view/params.h"
PARAMS(ComposeParams, 3)
BUFFER(0, readonly, uint, picture);  // [height,pictureWidth]
BUFFER(1, readonly, uint, layer);    // [H,frameWidth]
BUFFER(2, writeonly, uint, frame);   // [H,frameWidth]

// Of the pixel of the box that this invocation is for, in the frame; and of it in the picture.
uint placeInFrame(uint x, uint y) {
    return (params.y + y) * params.frameWidth + params.x + x;
}
uint placeInPicture(uint x, uint y) { return y * params.pictureWidth + x; }

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.pixels) return;
    uint y = quotient(i, params.byWidth), x = remainder(i, y, params.byWidth);
    uint at = placeInFrame(x, y);
    uint below = params.pictureWidth == 0 ? params.colour : picture.d[placeInPicture(x, y)];
    frame.d[at] = composed(below, layer.d[at], params.blueFirst);
}

ENTRY(patch) {
    uint i = linearIndex();
    if (i >= params.pixels) return;
    uint y = quotient(i, params.byWidth), x = remainder(i, y, params.byWidth);
    frame.d[placeInFrame(x, y)] = picture.d[placeInPicture(x, y)];
}
