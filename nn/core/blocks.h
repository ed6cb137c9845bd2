// How a kernel over a whole array (shaders/common/blocks.glsl) is spread over workgroups.
#pragma once

#include "common/blocks.h"
#include "engine/device.h"
#include "engine/files/numbers.h"
#include "engine/recorder.h"

namespace doppel {

// Lanes of a CPU's vectors, where kernels load blocks as whole vectors; 0 elsewhere.
inline uint32_t blockLanes(const Device& device) {
    const uint32_t lanes = device.kernelPath().vectorLanes;
    return lanes == 8 || lanes == 16 ? lanes : 0;
}

// Digits in base 4 of numbers below count: one of two values, for each makes a kernel of its own.
inline uint32_t blockDigits(uint64_t count) { return count <= 4096 ? 6 : 12; }

// So many elements fill workgroups of sixteen subgroups.
constexpr int64_t kPlacesWhole = int64_t{kBlocksEach} * kBlockElements * 16;

// Of a kernel made of EACH_PLACE over n elements, what Graph::dispatchGroups takes.
struct Places {
    Groups groups{0, 0, 0};    // 0: as many as hold the invocations
    uint64_t invocations = 0;  // 0: the groups say it
    Specialisation spec;
};

inline Places placesOf(const Device& device, uint64_t n) {
    const uint32_t lanes = blockLanes(device);
    const uint64_t subgroups = n / (kBlocksEach * kBlockElements);
    // Workgroups of sixteen subgroups, or of four; smaller ones, and arrays that are no multiple,
    // are better off without.
    const uint32_t together = subgroups % 16 == 0 ? 16 : 4;
    const bool whole = n % (uint64_t{kBlocksEach} * kBlockElements * together) == 0;
    if (lanes == 0 || !whole || subgroups < 64 || subgroups / together > 65535)
        return {.invocations = pairInvocations(n)};
    return {.groups = {u32(subgroups / together), 1, 1},
            .spec = {{"local_size", lanes * together},
                     {"kLanes", lanes},
                     {"kDigits", blockDigits(subgroups)}}};
}

}  // namespace doppel
