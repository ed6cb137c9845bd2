// Between the networks' images (planes of one channel) and the rasterizer's textures (channels side
// by side).
#pragma once

#include <vector>

#include "nn/core/graph.h"

namespace doppel {

// x [N,C,H,W] as N textures [H,W,C]. Gradient to x.
std::vector<Tensor> interleave(Graph& graph, const Tensor& x);

}  // namespace doppel
