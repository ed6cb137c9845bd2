#ifndef COMMON_BLOCKS_H
#define COMMON_BLOCKS_H
#include "common/pairs.h"
#include "common/shared.h"
SHARED_BEGIN
// 0, 1, 2, 3: see uniformOf() in common/blocks.glsl.
struct Digits {
#ifdef __cplusplus
    uint digit[4] = {0, 1, 2, 3};
#else
    uint digit[4];
#endif
};
#ifdef __cplusplus
constexpr uint kBlockElements = 32, kBlocksEach = 8;
#else
const uint kBlockElements = 32;
const uint kBlocksEach = 8;  // of a subgroup
#endif
SHARED_END
#endif
