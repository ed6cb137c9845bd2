// Ops on each element by itself, and concatenation. Any shape unless said otherwise.
#pragma once

#include "nn/core/graph.h"

namespace doppel {

// y = x where x > 0, slope * x elsewhere, slope >= 0. Gradient to x.
Tensor leakyRelu(Graph& graph, const Tensor& x, float slope);
// y = max(x, 0). Gradient to x, none at 0.
Tensor relu(Graph& graph, const Tensor& x);
// Gradient to x.
Tensor tanh(Graph& graph, const Tensor& x);
// y = 1 / (1 + exp(-x)). Gradient to x.
Tensor sigmoid(Graph& graph, const Tensor& x);
// y = scale * x + shift. Gradient to x.
Tensor scaleShift(Graph& graph, const Tensor& x, float scale, float shift);
// y = x within [low, high], the bound elsewhere. Gradient to x, none outside.
Tensor clamp(Graph& graph, const Tensor& x, float low, float high);

// Two tensors of the same shape. Gradients to both.
Tensor add(Graph& graph, const Tensor& a, const Tensor& b);
Tensor multiply(Graph& graph, const Tensor& a, const Tensor& b);

// a and b one after the other along an axis: [N,C,H,W] and [N,D,H,W] give [N,C+D,H,W] for axis 1.
// The other dimensions agree. Gradients to both.
Tensor concat(Graph& graph, const Tensor& a, const Tensor& b, int axis = 1);
// The same with the negative elements zero, in one pass.
Tensor concatRelu(Graph& graph, const Tensor& a, const Tensor& b, int axis = 1);

// Zero with probability rate, else x / (1 - rate). What is dropped is a hash of the seed and the
// step in graph.step(), of stream (different for each dropout of a network) and of the element.
// For training; a network in evaluation leaves it out. Gradient to x.
Tensor dropout(Graph& graph, const Tensor& x, float rate, uint32_t stream);

}  // namespace doppel
