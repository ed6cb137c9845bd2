// How kernels over whole arrays (shaders/common/blocks.glsl) are dispatched.
#pragma once

#include "common/blocks.h"
#include "nn/core/graph.h"
#include "nn/ops/linalg.h"

namespace doppel {

// Lanes of a CPU's vectors, where kernels load blocks as whole vectors; 0 elsewhere.
inline uint32_t blockLanes(const Device& device) {
    uint32_t lanes = vectorLanes(device);
    return lanes == 8 || lanes == 16 ? lanes : 0;
}

// Digits in base 4 of numbers below count: one of two values, for each makes a kernel of its own.
inline uint32_t blockDigits(uint64_t count) { return count <= 4096 ? 6 : 12; }

// So many elements fill workgroups of sixteen subgroups.
constexpr int64_t kPlacesWhole = int64_t{kBlocksEach} * kBlockElements * 16;

// A dispatch of a kernel made of EACH_PLACE over n elements. blocks: they may be taken in blocks.
template <typename Params>
void dispatchPlaces(Graph& graph, const char* kernel, std::initializer_list<Argument> arguments,
                    const Params& params, uint64_t n, Specialisation spec = {},
                    bool blocks = true) {
    uint32_t lanes = blockLanes(graph.device());
    uint64_t subgroups = n / (kBlocksEach * kBlockElements);
    // Workgroups of sixteen subgroups, or of four; smaller ones, and arrays that are no multiple,
    // are better off without.
    uint32_t together = subgroups % 16 == 0 ? 16 : 4;
    bool whole = n % (uint64_t{kBlocksEach} * kBlockElements * together) == 0;
    if (!blocks || lanes == 0 || !whole || subgroups < 64 || subgroups / together > 65535) {
        graph.dispatch(kernel, arguments, params, pairInvocations(n), spec);
        return;
    }
    spec["local_size"] = lanes * together;
    spec["kLanes"] = lanes;
    spec["kDigits"] = blockDigits(subgroups);
    graph.dispatchGroups(kernel, arguments, params,
                         {static_cast<uint32_t>(subgroups / together), 1, 1}, spec);
}

}  // namespace doppel
