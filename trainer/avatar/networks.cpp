#include "trainer/avatar/networks.h"

#include "nn/ops/elementwise.h"
#include "nn/ops/gan.h"
#include "nn/ops/texture.h"
#include "trainer/avatar/checkpoint.h"

namespace doppel {

// ---- stage 1 ------------------------------------------------------------------------------------

void declareMeshNet(Parameters& parameters, const Avatar& avatar, uint64_t seed) {
    addMeshNetParameters(parameters, meshNetConfig(avatar.preset.mesh),
                         static_cast<uint32_t>(seed));
}

MeshNetwork meshNetwork(Graph& graph, const Avatar& avatar, const Parameters& parameters) {
    const MeshPreset& preset = avatar.preset.mesh;
    return meshNetwork(graph, avatar.body, meshNetConfig(preset), preset.clamps, parameters);
}

// ---- stage 2 ------------------------------------------------------------------------------------

TextureUnetConfig textureUnetConfig(const TexturePreset& preset) {
    TextureUnetConfig config;
    config.size = preset.textureSize;
    config.width = preset.width;
    config.downs = preset.depth;
    config.block = preset.block;
    return config;
}

std::vector<float> texelsOf(const Avatar& avatar) {
    const auto size = static_cast<size_t>(avatar.preset.texture.textureSize);
    if (!avatar.texels.empty() && avatar.texels.size() != 3 * size * size)
        throwInput(
            "texture.textureSize: expected {}, as the avatar's texels have, found {}; train stage "
            "texels again with the new size, or keep the old one",
            avatar.textureSize, size);
    return avatar.texels;
}

TextureNet::TextureNet(Device& device, const Avatar& avatar, uint64_t seed)
    : preset_(avatar.preset.texture),
      unet_(textureUnetConfig(preset_), "texture", static_cast<uint32_t>(seed), texelsOf(avatar)) {
    unet_.allocate(device);
}

TextureNet::TextureNet(Device& device, const Avatar& avatar)
    : preset_(avatar.preset.texture),
      unet_(textureUnetConfig(preset_), "texture", std::nullopt, texelsOf(avatar)) {
    unet_.allocate(device);
    loadWeights(unet_.parameters(), avatar.textureNet, "texture_net.safetensors");
    loadWeights(unet_.statistics(), avatar.textureNet, "texture_net.safetensors");
}

WeightMap TextureNet::weights() const { return weightsOf(unet_); }

std::vector<Tensor> TextureNet::forward(Graph& graph, const std::vector<Tensor>& maps,
                                        bool training) const {
    return paintTextures(graph, unet_, maps, {training, training && preset_.dropout > 0});
}

std::vector<float> paintedTexture(Device& device, const TextureNet& net) {
    Graph graph(device);
    Tensor texture = net.forward(graph, {}, false).at(0);
    graph.output(texture);
    graph.compile();
    graph.run();
    return graph.read<float>(texture);
}

void paintTexture(Device& device, Avatar& avatar) {
    TextureNet net(device, avatar);
    avatar.textureSize = avatar.preset.texture.textureSize;
    avatar.texture = paintedTexture(device, net);
}

// ---- stage 3 ------------------------------------------------------------------------------------

RefineNet::RefineNet(Device& device, const Avatar& avatar)
    : unet_(refineUnetConfig(avatar.preset.refine, avatar.preset.texture), "refine", std::nullopt),
      residual_(avatar.preset.refine.residual) {
    unet_.allocate(device);
    loadWeights(unet_.parameters(), avatar.refineNet, "refine_net.safetensors");
    loadWeights(unet_.statistics(), avatar.refineNet, "refine_net.safetensors");
}

Tensor RefineNet::forward(Graph& graph, const TextureNet& coarse, std::span<const float> constant,
                          const Tensor& map) const {
    int64_t size = unet_.config().size;
    Tensor maps = map.reshaped({1, 1, size, size}), planes;
    if (constant.empty())
        planes =
            scaleShift(graph, coarse.unet().forward(graph, maps, {.frozen = true}), 0.5f, 0.5f);
    else
        planes = planar(graph, {graph.constant(constant, {size, size, 3})});
    return interleave(graph,
                      refineTextures(graph, unet_, planes, maps, {.frozen = true}, residual_))
        .at(0);
}

WeightMap weightsOf(const TextureUnet& unet) {
    WeightMap all = readWeights(unet.parameters());
    all.merge(readWeights(unet.statistics()));
    return all;
}

}  // namespace doppel
