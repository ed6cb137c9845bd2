#ifndef TEXTURE_PARAMS_H
#define TEXTURE_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct InterleaveParams {
    uint channels, pixels;
};
const uint kBinomialRows = 8;  // of an invocation
struct BinomialMeanParams {
    uint columns;       // of kBinomialRows elements or fewer
    uint line, height;  // elements of a line of texels; lines
    uint channels;
};
struct PixelShuffleParams {
    uint n;              // elements
    uint height, width;  // of a coarse plane
    uint block;          // r
};
struct LitTextureParams {
    uint texels;
    uint partials;  // of the sums over texels
};
SHARED_END
#endif
