#include "nn/core/initialise.h"

#include <array>

#include "common/random.h"

namespace doppel {

uint32_t streamOf(std::string_view name) {
    uint32_t hash = 2166136261u;
    for (char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619u;
    return hash;
}

std::vector<float> normalValues(uint32_t seed, std::string_view name, int64_t count, float mean,
                                float deviation) {
    std::vector<float> values(static_cast<size_t>(count));
    // randomBits(seed, draw, stream, element), with what does not depend on the element done once.
    std::array<uint32_t, 6> draws;
    for (uint32_t draw = 0; draw < draws.size(); ++draw)
        draws[draw] = mixBits(streamOf(name) ^ mixBits(draw ^ mixBits(seed)));
    for (size_t i = 0; i < values.size(); ++i) {
        int32_t sum = 0;
        for (uint32_t draw : draws) {
            uint32_t bits = mixBits(static_cast<uint32_t>(i) ^ draw);
            sum += static_cast<int32_t>((bits >> 16) + (bits & 0xffff));
        }
        // Twelve uniform numbers of 16 bits have this mean and nearly the variance 2^32.
        double standard = (sum - 6 * 65535) / 65536.0;
        values[i] = mean + static_cast<float>(standard * static_cast<double>(deviation));
    }
    return values;
}

std::vector<float> constantValues(int64_t count, float value) {
    return std::vector<float>(static_cast<size_t>(count), value);
}

}  // namespace doppel
