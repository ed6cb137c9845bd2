#ifndef FEATURES_PARAMS_H
#define FEATURES_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
// Windows over x [frames, channels, height, width]; the first begins padding before the first
// element, and what lies outside does not count.
struct MaxPoolParams {
    uint n;  // elements of y [outFrames, channels, outHeight, outWidth]
    uint channels;
    uint frames, height, width;
    uint outHeight, outWidth;
    uint kernelT, kernelH, kernelW;
    uint strideT, strideH, strideW;
    uint paddingT, paddingH, paddingW;
};
struct StackFramesParams {
    uint n;  // elements of y [outFrames, channels * kernelT, outHeight, outWidth]
    uint channels;
    uint frames, height, width;  // of x
    uint outHeight, outWidth;
    uint kernelT, strideT;
    uint paddingT, paddingH, paddingW;  // before the first
};
struct FeatureDistanceParams {
    uint n;  // pixels of all images
    uint channels;
    uint pixels;  // of one image
};
SHARED_END
#endif
