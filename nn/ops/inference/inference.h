// What small networks for phones are made of, beside nn/ops/conv/conv.h: for networks that are run
// and never trained. One picture [1,C,H,W] each; no gradients.
#pragma once

#include <array>
#include <span>

#include "nn/core/graph.h"

namespace doppel {

// Zeros around a picture: above, below, on the left, on the right.
struct Borders {
    uint32_t top = 0, bottom = 0, left = 0, right = 0;
    bool operator==(const Borders&) const = default;
};

// Weights and biases of a depthwise convolution as its kernel reads them: [C, texels * 4] from
// weight[C,K,K] and bias[C].
std::vector<float> depthwiseWeights(std::span<const float> weight, std::span<const float> bias,
                                    int64_t channels, int64_t kernel);

// y[1,C,H',W'] = each channel of x[1,C,H,W] with its kernel [K,K] every `stride` pixels of the
// padded picture, plus its bias; with relu6 the least of 6 and its positive part. weight is
// depthwiseWeights(). K is 3 or 5.
Tensor depthwiseConv2d(Graph& graph, const Tensor& x, const Tensor& weight, int64_t kernel,
                       int64_t stride, const Borders& borders, bool relu6);

// A convolution 1x1: y[1,O,H,W] = weight x (+ bias) (+ residual), relu6 as above, weight[O,C] and
// bias[O] being constants. With a residual [1,O,H,W] y is its memory, which is overwritten.
Tensor pixelConv2d(Graph& graph, const Tensor& x, std::span<const float> weight,
                   std::span<const float> bias, bool relu6, const Tensor& residual = {});

// y[1,C,2H,2W]: x, bilinear with pixel centres at a half, plus `more` [1,C,2H,2W] or an empty
// tensor.
Tensor upsample2(Graph& graph, const Tensor& x, const Tensor& more = {});

// y[1,C,2H,2W] from x[1,4C,H,W]: channel (2 i + j) C + c is row i, column j of the blocks of 2x2.
Tensor depthToSpace2(Graph& graph, const Tensor& x);

// y[1,H,W,C] = x[1,C,H,W].
Tensor channelsLast(Graph& graph, const Tensor& x);

}  // namespace doppel
