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
// A convolution 4x4 of stride 2 and padding 1 by tiles (conv/winograd.comp): of the finer image
// 6x6 pixels, of the coarser one 2x2.
struct WinogradParams {
    uint channels, height, width;  // of the image at hand, finer or coarser
    uint tiles;                    // of one image in this piece
    uint firstTile;                // the piece's first, counted row by row; even
    uint images;                   // their tiles follow each other
    uint startImage;               // elements to the first image
    uint strideMatrix;             // elements from one of the nine matrices to the next
    Divisor byPairs;               // tiles of a row, by two
};
struct WinogradWeightsParams {
    uint pairs;         // coarse * fine channels
    uint strideMatrix;  // 4 pairs
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
