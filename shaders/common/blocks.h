#ifndef COMMON_BLOCKS_H
#define COMMON_BLOCKS_H
#include "common/pairs.h"
#include "common/constants.h"
SHARED_BEGIN
// 0, 1, 2, 3: see uniformOf() in common/blocks.glsl.
struct Digits {
#ifdef __cplusplus
    uint digit[4] = {0, 1, 2, 3};
#else
    uint digit[4];
#endif
};
SHARED_CONSTANT uint kBlockElements = 32;
SHARED_CONSTANT uint kBlocksEach = 8;  // of a subgroup
SHARED_END
#endif
