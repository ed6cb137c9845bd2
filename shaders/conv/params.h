#ifndef CONV_PARAMS_H
#define CONV_PARAMS_H
#include "common/divide.h"
#include "common/shared.h"
SHARED_BEGIN
// Windows of kernel size slide over an image [channels, height, width] with a stride and padding;
// outHeight x outWidth of them fit. Kernel and stride are specialisation constants.
struct ColumnsParams {
    uint channels, height, width;
    uint outWidth;
    uint windows;      // of this part, of one image
    uint firstWindow;  // the part's first, counted row by row
    uint images;       // their windows follow each other
    uint startImage;   // elements to the first image
    uint padding;
    Divisor byOutWidth;
};
struct ImageParams {
    uint channels, height, width;  // channels: of columns
    uint outHeight, outWidth;      // windows
    uint images;
    uint startImage, strideImage;
    uint padding;
    uint firstChannel;  // of the image's: columns hold some of its channels, image and bias all
    Divisor byWidth;
};
struct MapsParams {
    uint elements;         // of some images: images * features * windows
    uint start;            // of the first image
    uint windows, images;
    Divisor byWindows, byFeatures;
};
struct BatchNormParams {
    uint images, channels, pixels;  // x[images, channels, pixels]
    uint threads;                   // partial sums per channel
    float epsilon;
    float momentum;  // of the running statistics
    float slope;     // of a leaky ReLU behind; 1: none
};
SHARED_END
#endif
