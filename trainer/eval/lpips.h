// LPIPS, version 0.1, of Zhang et al., The Unreasonable Effectiveness of Deep Features as a
// Perceptual Metric (CVPR 2018), on our own ops with the user's weights.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "engine/device.h"
#include "engine/io/safetensors.h"
#include "nn/nets/perceptual.h"

namespace doppel {

class Lpips {
public:
    // files: the backbone, called as in torchvision ("features.0.weight"), and the heads, called as
    // in the authors' files ("lin0.model.1.weight"), in one file or several; or a whole LPIPS
    // model's state_dict ("net.slice1.0.weight", "lins.0.model.1.weight"). See readWeights.
    // InputError that says which tensor is missing or has another shape.
    Lpips(Device& device, LpipsNet net, const std::vector<std::filesystem::path>& files);
    Lpips(Device& device, LpipsNet net, std::vector<Safetensors> files);
    ~Lpips();

    LpipsNet net() const { return net_; }
    // a, b: [H][W][3], sRGB-encoded in [0,1]. 0 for equal pictures. InputError for pictures smaller
    // than the network can take.
    double distance(std::span<const float> a, std::span<const float> b, int width, int height);

private:
    struct Recording;
    Device& device_;
    LpipsNet net_;
    std::map<std::string, Tensor32> weights_;  // by torchvision's names, and "lin0" …
    std::unique_ptr<Recording> recording_;     // for pictures of the latest size
};

}  // namespace doppel
