// The U-Net that paints textures (Isola et al., Image-to-Image Translation with Conditional
// Adversarial Networks, CVPR 2017), as the paper's stages 2 and 3 use it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "nn/core/graph.h"

namespace doppel {

struct TextureUnetConfig {
    int64_t size = 512;  // pixels of the square input and output
    int64_t width = 64;  // features of the first layer
    int64_t inputChannels = 1, outputChannels = 3;
    int64_t downs = 0;  // 0: down to one pixel
    // Side of the blocks of pixels that the network takes as one, their pixels as channels: a
    // network of half the size paints a texture of the whole.
    int64_t block = 1;
};

// n steps down (4x4 convolutions of stride 2; features d, 2d, 4d, 8d, 8d, …) and n up (transposed
// ones), leaky ReLU before each step down but the first, ReLU before each up, batch normalisation
// after all but the first, innermost and last, dropout in up steps 2 to 5, the output of each step
// down concatenated to that of the step up of its size; tanh at the end.
//
// Parameters: enc1 … encN, dec1 (innermost) … decN: ".weight", ".bias" where no normalisation
// follows, "encI_bn.weight" and so on. Weights start normal with deviation 0.02, scales of the
// normalisation normal around 1, biases zero.
class TextureUnet {
public:
    static constexpr float kTexelResidual = 0.5f;  // of [-1, 1]
    static constexpr float kSlope = 0.2f;          // of the leaky ReLUs

    // InputError where the sizes do not fit. The same seed and name give the same values anywhere;
    // name keeps two networks of one seed apart.
    // Without a seed all values are zeros: others are to be loaded after allocate().
    // texels [size,size,3] in [0,1]: a texture that the network paints over. It is three more
    // channels of the input, and the output is what the network adds to it, kTexelResidual at most,
    // clamped.
    TextureUnet(const TextureUnetConfig& config, std::string name, std::optional<uint32_t> seed,
                std::vector<float> texels = {});

    // Texels [size,size,3] in [0,1] as the network takes them, [3,size,size] in [-1,1].
    static std::vector<float> planesOf(const std::vector<float>& texels);

    void allocate(Device& device);

    const TextureUnetConfig& config() const { return config_; }
    Parameters& parameters() { return parameters_; }
    const Parameters& parameters() const { return parameters_; }
    // Running mean and variance of every normalisation, "encI_bn.running_mean" and so on: not
    // trained by gradients, but part of what is saved.
    Parameters& statistics() { return statistics_; }
    const Parameters& statistics() const { return statistics_; }

    struct Mode {
        bool training = false;  // statistics of the batch, which move the running ones; or those
        bool dropout = false;   // needs graph.setStep() for fresh ones every step
        bool frozen = false;    // parameters are constants of the gradient
    };
    // x [N, inputChannels, size, size] -> [N, outputChannels, size, size] in [-1, 1]. Gradients to
    // x and all parameters. allocate() comes before.
    Tensor forward(Graph& graph, const Tensor& x, Mode mode) const;

private:
    int64_t features(int64_t step) const;  // after step 1 … downs
    void declare(const std::string& layer, Shape weight, bool normalised, int64_t out,
                 std::optional<uint32_t> seed);
    Tensor parameter(Graph& graph, const std::string& name, Mode mode) const;
    Tensor normalise(Graph& graph, const Tensor& x, const std::string& layer, float slope,
                     Mode mode) const;

    TextureUnetConfig config_;
    std::string name_;
    std::vector<float> texels_;  // [3,size,size] in [-1,1]; empty: none
    Parameters parameters_, statistics_;
};

}  // namespace doppel
