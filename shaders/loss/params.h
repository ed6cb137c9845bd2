#ifndef LOSS_PARAMS_H
#define LOSS_PARAMS_H
#include "common/camera.h"
#include "common/shared.h"
SHARED_BEGIN
struct SilhouetteIouLossParams {
    uint n;         // pixels
    uint partials;  // first sums, each over every partials-th pixel
};
struct MaskedL1LossParams {
    uint n;  // pixels
    uint channels;
    uint partials;
};
struct SsimParams {
    uint width, height, channels;  // stored [H,W,C]
    uint partials;
};
struct KeypointLossParams {
    uint joints;
    float scale;  // pixels
};
struct PyramidLossParams {
    uint width, height, channels;
    uint blocksAcross, blocks;  // of 8x8 pixels: in a line, in all
    float weight1, weight2, weight4, weight8;  // of cells of so many pixels a side
    float epsilon;
};
struct Dilate3Params {
    uint n;  // elements of all pictures
    uint width, height;
};
SHARED_END
#endif
