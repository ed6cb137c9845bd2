// PatchGAN discriminators (Isola et al., CVPR 2017): a logit for each patch of a picture.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "nn/core/graph.h"

namespace doppel {

// 4x4 convolutions of padding 1: `strided` of stride 2, then `level` of stride 1, of width, 2
// width, 4 width, … features, and one of stride 1 to a single logit; leaky ReLU 0.2 between them,
// batch normalisation (of the batch itself) on all but the first and the last.
struct PatchDiscriminatorConfig {
    int64_t inputChannels = 3;
    int64_t width = 64;
    int64_t strided = 3, level = 2;
};
// The method's D2, on whole pictures, and D1, on faces; d as the paper's 64.
PatchDiscriminatorConfig imageDiscriminator(int64_t d);
PatchDiscriminatorConfig faceDiscriminator(int64_t d);

// Parameters: conv1 … convN: ".weight", ".bias" where no normalisation follows, "convI_bn.weight"
// and so on, starting as the U-Net's.
class PatchDiscriminator {
public:
    PatchDiscriminator(const PatchDiscriminatorConfig& config, std::string name, uint32_t seed);

    void allocate(Device& device) { parameters_.allocate(device); }
    const PatchDiscriminatorConfig& config() const { return config_; }
    Parameters& parameters() { return parameters_; }
    const Parameters& parameters() const { return parameters_; }
    // Pictures have to be at least so large, in pixels.
    int64_t smallestPicture() const;

    // The parameters on a graph, once for all uses that share a gradient. Frozen: constants of the
    // gradient, as the generator's update takes them. allocate() comes before.
    using Tensors = std::map<std::string, Tensor>;
    Tensors trained(Graph& graph) const;
    Tensors frozen(Graph& graph) const;

    // x [N,inputChannels,H,W] -> logits [N,1,H',W']. Gradients to x and to trained parameters.
    Tensor forward(Graph& graph, const Tensors& parameters, const Tensor& x) const;

private:
    int64_t layers() const { return config_.strided + config_.level + 1; }

    PatchDiscriminatorConfig config_;
    Parameters parameters_;
};

}  // namespace doppel
