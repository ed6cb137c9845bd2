// Python's pickle machine, for data alone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "engine/io/pickles/pickle_graph.h"

namespace doppel::pickle {

// Runs the opcodes at the front of `bytes` and returns the root's number in the graph. name: for
// errors. torch: the pickle is part of a PyTorch file. consumed: how many bytes the opcodes took.
uint32_t run(std::span<const uint8_t> bytes, const std::string& name, PickleGraph& graph,
             bool torch, size_t& consumed);

}  // namespace doppel::pickle
