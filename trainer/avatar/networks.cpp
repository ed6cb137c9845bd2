#include "trainer/avatar/networks.h"

#include "nn/ops/elementwise.h"
#include "nn/ops/gan.h"
#include "nn/ops/texture.h"
#include "trainer/avatar/checkpoint.h"

namespace doppel {

namespace {

TextureUnetConfig unetConfig(const TexturePreset& preset) {
    TextureUnetConfig config;
    config.size = preset.textureSize;
    config.width = preset.width;
    config.downs = preset.depth;
    return config;
}

}  // namespace

AdamWOptions adamwOptions(double beta1, double beta2, double weightDecay) {
    AdamWOptions options;
    options.beta1 = static_cast<float>(beta1);
    options.beta2 = static_cast<float>(beta2);
    options.weightDecay = static_cast<float>(weightDecay);
    return options;
}

// ---- stage 1 ------------------------------------------------------------------------------------

void declareMeshNet(Parameters& parameters, const Avatar& avatar, uint64_t seed) {
    addMeshNetParameters(parameters, meshNetConfig(avatar.preset.mesh),
                         static_cast<uint32_t>(seed));
}

MeshNetConfig meshNetConfig(const MeshPreset& preset) {
    return {.blocks = preset.blocks,
            .layers = preset.layers,
            .hidden = preset.hidden,
            .deviation = static_cast<float>(preset.deviation)};
}

ClampBounds clampsOf(const MeshPreset& preset) {
    return preset.clamps == "none"      ? ClampBounds::None
           : preset.clamps == "program" ? ClampBounds::Program
                                        : ClampBounds::Paper;
}

MeshNetwork meshNetwork(Graph& graph, const Avatar& avatar, const Parameters& parameters) {
    const MeshPreset& preset = avatar.preset.mesh;
    return meshNetwork(graph, avatar.body, meshNetConfig(preset), clampsOf(preset), parameters);
}

// ---- stage 2 ------------------------------------------------------------------------------------

TextureNet::TextureNet(Device& device, const TexturePreset& preset, uint64_t seed)
    : preset_(preset), unet_(unetConfig(preset), "texture", static_cast<uint32_t>(seed)) {
    unet_.allocate(device);
}

TextureNet::TextureNet(Device& device, const TexturePreset& preset, const WeightMap& weights)
    : preset_(preset), unet_(unetConfig(preset), "texture", std::nullopt) {
    unet_.allocate(device);
    loadWeights(unet_.parameters(), weights, "texture_net.safetensors");
    loadWeights(unet_.statistics(), weights, "texture_net.safetensors");
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
    TextureNet net(device, avatar.preset.texture, avatar.textureNet);
    avatar.textureSize = avatar.preset.texture.textureSize;
    avatar.texture = paintedTexture(device, net);
}

// ---- stage 3 ------------------------------------------------------------------------------------

RefineConfig refineConfig(const Preset& preset) {
    const RefinePreset& p = preset.refine;
    auto f = [](double value) { return static_cast<float>(value); };
    RefineConfig config;
    config.size = p.size;
    config.textureSize = preset.texture.textureSize;
    config.width = p.width;
    config.depth = p.depth;
    config.discriminatorWidth = p.discriminatorWidth;
    config.faceSize = p.faceSize;
    config.batch = p.batch;
    config.dropout = p.dropout > 0;
    config.imageDiscriminator = p.imageDiscriminator;
    config.faceDiscriminator = p.faceDiscriminator;
    config.leastSquares = p.loss == "squares";
    config.adversarial = f(p.adversarial);
    config.reconstruction = f(p.reconstruction);
    config.misaligned = f(p.misaligned);
    config.unionRegion = p.region == "union";
    config.ownMasks = p.masks == "own";
    config.oneSided = p.apart == "rendered";
    config.residual = p.residual == "program" ? Residual::Program : Residual::Clamped;
    config.generatorOptimiser = adamwOptions(p.beta1, p.beta2, p.weightDecay);
    config.discriminatorOptimiser = config.generatorOptimiser;
    config.discriminatorOptimiser.rateScale = f(p.lrDiscriminator / p.lr);
    return config;
}

RefineNet::RefineNet(Device& device, const Avatar& avatar)
    : unet_(refineUnetConfig(refineConfig(avatar.preset)), "refine", std::nullopt),
      residual_(refineConfig(avatar.preset).residual) {
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
