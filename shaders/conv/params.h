#ifndef CONV_PARAMS_H
#define CONV_PARAMS_H
#include "common/blocks.h"
#include "common/divide.h"
#include "common/shared.h"
SHARED_BEGIN
// Windows of kernel size slide over an image [channels, height, width] with a stride and padding;
// outHeight x outWidth of them fit. Kernel and stride are specialisation constants.
struct ColumnsParams {
    uint channels, height, width;
    uint windows;      // of this part, of one image
    uint firstWindow;  // the part's first, counted row by row
    uint images;       // their windows follow each other
    uint startImage;   // elements to the first image
    uint padding;
    uint rows;         // channels times places of the kernel
    Divisor byOutWidth;  // windows of a row
};
struct ImageParams {
    uint height, width;
    uint outHeight, outWidth;      // windows
    uint images;
    uint startImage, strideImage;
    uint padding;
    uint firstChannel;  // of the image's: columns hold some of its channels, image and bias all
    Divisor byWidth;  // of the image; sum_blocks: outWidth
};
struct MapsParams {
    uint elements;         // of some images: images * features * windows
    uint start;            // of the first image
    uint windows, images;
    Divisor byWindows, byFeatures;
};
// A convolution by tiles: 4x4 of stride 2 and padding 1 (conv/winograd.comp), or of stride 1
// (conv/winograd_dense.comp).
struct WinogradParams {
    uint channels, height, width;     // of the image at hand
    uint firstChannel, partChannels;  // those that this dispatch makes
    uint tiles;                    // of one image in this piece
    uint firstTile;                // the piece's first, counted row by row; even for stride 2
    uint images;                   // their tiles follow each other
    uint startImage;               // elements to the first image
    uint strideMatrix;             // elements from one matrix to the next
    uint panelSteps;               // that a panel of rows has: tiles, or some more
    uint padding;                  // stride 1
    Divisor byRow;                 // stride 1: tiles of a row; stride 2: pairs of them
};
struct WinogradWeightsParams {
    uint invocations;
    uint features, channels;  // stride 2: coarse and fine
    uint first;               // of the features or, turned, channels that this dispatch makes
    uint strideMatrix;        // elements from one matrix to the next
    uint panelSteps;          // that a panel has
    Divisor bySteps;          // channels or, turned, features
};
struct BatchNormParams {
    uint images, channels, pixels;  // x[images, channels, pixels]
    uint threads;                   // partial sums per channel
    float epsilon;
    float momentum;  // of the running statistics
    float slope;     // of a leaky ReLU behind; 1: none
};
struct BatchNormBlocksParams {
    uint channels;
    uint chunks;  // of a channel of an image
    float slope;  // as above
    float all;    // 1 / (images * pixels)
    Digits digits;
};
const uint kChunkElements = kBlocksEach * kBlockElements;  // what a subgroup takes
SHARED_END
#endif
