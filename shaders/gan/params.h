#ifndef GAN_PARAMS_H
#define GAN_PARAMS_H
#include "common/divide.h"
#include "common/shared.h"
SHARED_BEGIN
struct PlanarParams {
    uint channels, pixels;
};
struct CropWindowParams {
    uint width, height;
    uint size;  // of the window's side
    Divisor byChannels;  // of a picture
};
struct GanLossParams {
    uint n;       // logits
    float label;  // 1: real, 0: fake
};
struct MisalignedRegionParams {
    uint width;
    uint row;       // of the centres
    uint faceSize;  // pixels
    uint oneSided;
};
SHARED_END
#endif
