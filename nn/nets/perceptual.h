// Networks that judge pictures and videos, with weights of their authors' making: the backbones of
// LPIPS (Zhang et al., The Unreasonable Effectiveness of Deep Features as a Perceptual Metric, CVPR
// 2018) and Inception-3D (Carreira and Zisserman, Quo Vadis, Action Recognition?, CVPR 2017). For
// metrics: no gradients, no dropout, running statistics.
#pragma once

#include <functional>
#include <string_view>
#include <vector>

#include "nn/core/graph.h"

namespace doppel {

// Gives a network its weights by name; the shape is what the network needs.
using WeightSource = std::function<Tensor(const std::string& name, const Shape& shape)>;

enum class LpipsNet { alex, vgg, squeeze };

// InputError for other names than alex, vgg and squeeze.
LpipsNet lpipsNetByName(std::string_view name, std::string_view where);
const char* lpipsNetName(LpipsNet net);
// Channels of each layer that is compared.
const std::vector<int64_t>& lpipsChannels(LpipsNet net);
// The smallest picture that the network has a pixel left of, at its last layer.
int64_t lpipsSmallestSide(LpipsNet net);

// x[N,3,H,W], colours from -1 to 1, to the compared layers [N,C,H',W']: AlexNet after each of its
// five ReLUs; VGG16 before each pooling and after the last ReLU; SqueezeNet 1.1 after the first
// ReLU, before the poolings and after the last four modules. Weights are called as in torchvision,
// "features.0.weight".
std::vector<Tensor> lpipsFeatures(Graph& graph, LpipsNet net, const Tensor& x,
                                  const WeightSource& weights);

// x[T,3,H,W], colours from -1 to 1, to [1,classes]: the logits of Inception-3D's mean features over
// time and space, which for 16 frames of 224x224 is what the published network computes. Weights
// are called "Conv3d_1a_7x7.conv3d.weight", "Mixed_3b.b1a.bn.running_var", "logits.conv3d.bias".
Tensor inception3dLogits(Graph& graph, const Tensor& x, int64_t classes,
                         const WeightSource& weights);

}  // namespace doppel
