#ifndef TEXTURE_PARAMS_H
#define TEXTURE_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct InterleaveParams {
    uint channels, pixels;
};
struct BinomialMeanParams {
    uint n;             // elements
    uint line, height;  // elements of a line of texels; lines
    uint channels;
};
SHARED_END
#endif
