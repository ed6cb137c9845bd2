#ifndef COMMON_PAIRS_H
#define COMMON_PAIRS_H
#include "common/constants.h"
SHARED_BEGIN
SHARED_CONSTANT uint kPairsEach = 4;  // of an invocation
#ifdef __cplusplus
// Invocations that a dispatch over n elements in pairs needs.
constexpr uint64_t pairInvocations(uint64_t n) {
    return (n + 2 * kPairsEach - 1) / (2 * kPairsEach);
}
#endif
SHARED_END
#endif
