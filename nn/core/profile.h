// Where a replay's time goes, as a table for people.
#pragma once

#include <string>

#include "nn/core/graph.h"

namespace doppel {

// Of the newest replay, compiled with timestamps: a line for all ops of one name, the slowest first, and one
// for all. Columns: ops, MiB bound to their dispatches, GFLOP, milliseconds.
std::string profileTable(Graph& graph, const std::string& title);

}  // namespace doppel
