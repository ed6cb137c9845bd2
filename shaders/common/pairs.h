#ifndef COMMON_PAIRS_H
#define COMMON_PAIRS_H
#include "common/shared.h"
SHARED_BEGIN
#ifdef __cplusplus
constexpr uint kPairsEach = 4;
// Invocations that a dispatch over n elements in pairs needs.
constexpr uint64_t pairInvocations(uint64_t n) {
    return (n + 2 * kPairsEach - 1) / (2 * kPairsEach);
}
#else
const uint kPairsEach = 4;  // of an invocation
#endif
SHARED_END
#endif
