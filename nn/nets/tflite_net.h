// Networks for phones from TensorFlow Lite files, on our own ops.
#pragma once

#include <vector>

#include "engine/io/tflite.h"
#include "nn/core/graph.h"

namespace doppel {

// Adds the model's operators to the graph, for x [1,C,H,W] in place of its one input [1,H,W,C].
// Returns its outputs in their order; images [1,H,W,C] come as [1,C,H,W]. What follows a
// convolution or an enlargement (ReLU6, the sum with what went around it) is done in the same
// pass, so that the graph has fewer dispatches than the model operators. InputError names the
// model's file where an operator has a form that no network of ours has needed, or where its
// tensors' shapes do not go together.
std::vector<Tensor> tfliteNet(Graph& graph, const TfliteModel& model, const Tensor& x);

}  // namespace doppel
