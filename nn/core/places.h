// Dispatches of kernels over whole arrays (shaders/common/blocks.glsl).
#pragma once

#include "nn/core/blocks.h"
#include "nn/core/graph.h"

namespace doppel {

// Adds a dispatch of a kernel made of EACH_PLACE over n elements. blocks: they may be taken in
// blocks.
template <typename Params>
void dispatchPlaces(Graph& graph, const char* kernel, std::initializer_list<Argument> arguments,
                    const Params& params, uint64_t n, Specialisation spec = {},
                    bool blocks = true) {
    const Places places = placesOf(graph.device(), n, std::move(spec), blocks);
    graph.dispatchGroups(kernel, arguments, params, places.groups, places.spec, places.invocations);
}

}  // namespace doppel
