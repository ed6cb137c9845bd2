#ifndef INFERENCE_PARAMS_H
#define INFERENCE_PARAMS_H
#include "common/divide.h"
#include "common/shared.h"
SHARED_BEGIN
// One convolution per channel, bias and ReLU6 in it: kernel, stride, padding on the left and what
// an invocation makes are specialisation constants.
struct DepthwiseParams {
    uint n;  // invocations: channels * groups of rows * groups of four columns
    uint height, width;        // of x
    uint outHeight, outWidth;  // of y
    uint paddingTop;
    Divisor byColumns, byRows;  // groups of a row, groups of rows of a channel
};
// Twice the size; n: elements of y, or sixteen of them each.
struct UpsampleParams {
    uint n;
    uint height, width;         // of x
    Divisor byColumns, byRows;  // of y, or texels of a row of x and rows of x
};
struct DepthToSpaceParams {
    uint n;  // elements of y [channels, 2 height, 2 width]
    uint channels, height, width;
    Divisor byColumns, byRows;  // of y
};
struct ChannelsLastParams {
    uint n;  // elements
    uint channels, pixels;
    Divisor byChannels;
};
SHARED_END
#endif
