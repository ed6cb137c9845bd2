// Division by a number that stays the same for a dispatch, as a multiplication: a division is
// eight scalar ones on lavapipe and costs more than the loads and stores around it. Granlund and
// Montgomery, Division by Invariant Integers using Multiplication (PLDI 1994).
#ifndef COMMON_DIVIDE_H
#define COMMON_DIVIDE_H
#include "common/shared.h"
SHARED_BEGIN
struct Divisor {
    uint divisor, multiplier, shift;
};
SHARED_END
#ifdef __cplusplus
namespace doppel {
inline Divisor divisorOf(uint64_t divisor) {
    auto d = static_cast<uint32_t>(divisor);
    uint32_t log = 0;
    while ((uint64_t{1} << log) < d) ++log;
    if (log == 0) return {1, 0, 0};
    uint64_t multiplier = ((uint64_t{1} << (31 + log)) / d) + 1;
    return {d, static_cast<uint32_t>(multiplier), log - 1};
}
}  // namespace doppel
#else
// value / by, for value < 2^31.
uint quotient(uint value, Divisor by) {
    uint high, low;
    umulExtended(value, by.multiplier, high, low);
    return by.multiplier == 0 ? value : high >> by.shift;
}
uint remainder(uint value, uint quotient, Divisor by) { return value - quotient * by.divisor; }
#endif
#endif
