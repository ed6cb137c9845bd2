// The method's networks as an avatar's preset sizes them.
#pragma once

#include <span>
#include <vector>

#include "nn/steps/mesh_step.h"
#include "nn/steps/refine_step.h"
#include "nn/steps/texture_step.h"
#include "trainer/avatar/avatar.h"

namespace doppel {

// ---- stage 1 ------------------------------------------------------------------------------------

void declareMeshNet(Parameters& parameters, const Avatar& avatar, uint64_t seed);

MeshNetwork meshNetwork(Graph& graph, const Avatar& avatar, const Parameters& parameters);

// ---- stage 2 ------------------------------------------------------------------------------------

TextureUnetConfig textureUnetConfig(const TexturePreset& preset);
// What the texture network paints over, [size,size,3]; empty: nothing. InputError where the
// preset's size is not theirs.
std::vector<float> texelsOf(const Avatar& avatar);

// G_TN: visibility maps in, textures [size,size,3] in [0,1] out.
class TextureNet {
public:
    // Fresh, and with the avatar's weights; over the avatar's texels, where it has some.
    TextureNet(Device& device, const Avatar& avatar, uint64_t seed);
    TextureNet(Device& device, const Avatar& avatar);

    // maps [size,size] of a batch; none: a map of ones, which paints all sides at once. One texture
    // per map.
    std::vector<Tensor> forward(Graph& graph, const std::vector<Tensor>& maps, bool training) const;

    const TextureUnet& unet() const { return unet_; }
    Parameters& parameters() { return unet_.parameters(); }
    Parameters& state() { return unet_.statistics(); }
    WeightMap weights() const;

private:
    TexturePreset preset_;
    TextureUnet unet_;
};

// What the network paints for all sides, [size,size,3].
std::vector<float> paintedTexture(Device& device, const TextureNet& net);
// Lets the network paint avatar.texture for all sides.
void paintTexture(Device& device, Avatar& avatar);

// ---- stage 3 ------------------------------------------------------------------------------------

// G_RN as an avatar has it.
class RefineNet {
public:
    RefineNet(Device& device, const Avatar& avatar);

    // The refined texture [size,size,3] for a visibility map [size,size]; the coarse one is what
    // `coarse` paints for the map, or `constant` where that is not empty.
    Tensor forward(Graph& graph, const TextureNet& coarse, std::span<const float> constant,
                   const Tensor& map) const;

private:
    TextureUnet unet_;
    Residual residual_;
};

// Values and running statistics.
WeightMap weightsOf(const TextureUnet& unet);

}  // namespace doppel
