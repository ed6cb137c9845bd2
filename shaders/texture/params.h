#ifndef TEXTURE_PARAMS_H
#define TEXTURE_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct InterleaveParams {
    uint channels, pixels;
};
SHARED_END
#endif
