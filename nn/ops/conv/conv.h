// Convolutions and batch normalisation on images [N,C,H,W].
#pragma once

#include "nn/core/graph.h"

namespace doppel {

// y[N,O,H',W'] with H' = (H + 2 padding - kh) / stride + 1; weight [O,C,kh,kw], bias [O] or an
// empty tensor. Gradients to x, weight and bias.
Tensor conv2d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
              uint32_t stride, uint32_t padding);

// The transpose: y[N,O,H',W'] with H' = (H - 1) stride - 2 padding + kh; weight [C,O,kh,kw], bias
// [O] or an empty tensor. Gradients to x, weight and bias.
Tensor convTranspose2d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
                       uint32_t stride, uint32_t padding);

// What a batch normalisation keeps for evaluation; each [C].
struct RunningStatistics {
    Tensor mean, variance;
};

struct BatchNormOptions {
    float epsilon = 1e-5f;
    float momentum = 0.1f;  // of the running statistics
    float slope = 1;        // of a leaky ReLU that y passes in the same pass; 1: none
};

// y = (x - mean) / sqrt(variance + epsilon) * weight + bias, mean and (biased) variance of each
// channel over N, H and W. Where running is given, it moves towards them by momentum (the variance
// unbiased), in place. Gradients to x, weight and bias; mean and variance are differentiated.
Tensor batchNorm2d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
                   const BatchNormOptions& options = {}, const RunningStatistics& running = {});

// With the running statistics in place of x's own; they are constants of the gradient.
Tensor batchNorm2dEvaluation(Graph& graph, const Tensor& x, const Tensor& weight,
                             const Tensor& bias, const BatchNormOptions& options,
                             const RunningStatistics& running);

}  // namespace doppel
