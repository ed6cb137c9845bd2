#ifndef VIEW_PARAMS_H
#define VIEW_PARAMS_H
#include "common/divide.h"
#include "common/shared.h"
#include "raster/params.h"
SHARED_BEGIN
struct ShadeParams {
    uint width, height;  // of the picture
    uint textureSize;
    uint inset;  // side of the atlas shown in the lower right corner, pixels; 0: none
    Divisor byWidth;
};
struct LayerParams {
    uint width, height;  // of the picture
    Divisor byWidth;
};
struct AccumulateParams {
    uint pixels;
};
// A box of a frame.
struct ComposeParams {
    uint x, y;  // of the box in the frame
    uint pixels;
    Divisor byWidth;  // of the box
    uint frameWidth;
    uint pictureWidth;  // 0: of one colour, which is opaque
    uint colour;
    uint blueFirst;  // 1: the frame's bytes are B, G, R, A
};
// What the surface is painted with.
const uint kPaintTexture = 0;
const uint kPaintClay = 1;
const uint kPaintNormals = 2;
const uint kPaintVisibility = 3;  // the visibility map that the texture networks see
const uint kPaintChecker = 4;
const uint kPaintParts = 5;
const uint kPaintClamps = 6;
// What the surface is lit by. The capture's light is one of textures; on what else is painted, and
// where the avatar has none, it is as flat.
const uint kLightFlat = 0;
const uint kLightLamp = 1;
const uint kLightCapture = 2;
// How a view is lit; a buffer, because it changes between replays.
struct ShadeState {
    float ambient;  // of a light that fills the rest up to 1
    // Towards the lamp, unit length, and the rows of the rotation that brings normals to camera
    // space.
    float lampX, lampY, lampZ;
    float xx, xy, xz, yx, yy, yz, zx, zy, zz;
    float captureLight[24];  // L [8,3] of the avatar
};
SHARED_END
#endif
