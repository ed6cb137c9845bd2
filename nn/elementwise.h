// Ops on each element by itself.
#pragma once

#include "nn/graph.h"

namespace doppel {

// y = x where x > 0, slope * x elsewhere. Any shape. Gradient to x.
Tensor leakyRelu(Graph& graph, const Tensor& x, float slope);

// total += more, in place. The graph sums gradients with it; no gradient of its own.
void addInto(Graph& graph, const Tensor& total, const Tensor& more);

}  // namespace doppel
