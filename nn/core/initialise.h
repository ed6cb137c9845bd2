// Values that networks start from: a hash of seed, name and element, by integer arithmetic, so that
// every machine, compiler and order of declaration gives the same bits.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

namespace doppel {

// A number for a name, to keep random streams apart (FNV-1a).
uint32_t streamOf(std::string_view name);

// Normal numbers as the sum of twelve uniform ones: mean and deviation as asked, the fourth moment
// 3 % below a normal distribution's, nothing beyond six deviations.
std::vector<float> normalValues(uint32_t seed, std::string_view name, int64_t count, float mean,
                                float deviation);
std::vector<float> constantValues(int64_t count, float value);

}  // namespace doppel
