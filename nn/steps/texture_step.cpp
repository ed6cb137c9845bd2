#include "nn/steps/texture_step.h"

#include "nn/ops/elementwise.h"
#include "nn/ops/loss.h"
#include "nn/ops/texture.h"
#include "nn/steps/light.h"

namespace doppel {

Tensor regionOf(Graph& graph, Region region, const Tensor& a, const Tensor& b) {
    Tensor both = multiply(graph, a, b);
    if (region == Region::Intersection) return both;
    return add(graph, add(graph, a, b), scaleShift(graph, both, -1, 0));
}

std::vector<Tensor> paintTextures(Graph& graph, const TextureUnet& net,
                                  const std::vector<Tensor>& maps, TextureUnet::Mode mode) {
    int64_t size = net.config().size;
    Tensor x;
    for (const Tensor& map : maps) {
        Tensor one = map.reshaped({1, 1, size, size});
        x = x ? concat(graph, x, one, 0) : one;
    }
    if (!x) {
        std::vector<float> ones(static_cast<size_t>(size * size), 1.0f);
        x = graph.constant(std::span<const float>(ones), {1, 1, size, size});
    }
    return interleave(graph, scaleShift(graph, net.forward(graph, x, mode), 0.5f, 0.5f));
}

TextureStep::TextureStep(Device& device, const BodyModel& body, const TextureUnet& net,
                         const TexturePreset& preset, const CompileOptions& options,
                         std::span<const float> light)
    : graph(device) {
    graph.join(options.ranks);
    int64_t size = preset.size, texels = net.config().size;
    RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
    Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
    RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);

    const CaptureLight lights(graph, body, mesh, texels, light);

    // The network sees the whole batch at once, so its batch statistics are the batch's.
    std::vector<Tensor> maps;
    for (int i = 0; i < preset.batch / sizeOf(options.ranks); ++i) {
        Sample sample{graph.input(kCameraShape), graph.input({body.vertexCount, 3}),
                      graph.input({size, size, 3}), graph.input({size, size})};
        if (!preset.constantInput)
            maps.push_back(visibilityMap(graph, mesh, sample.verts, atlas, texels));
        samples.push_back(sample);
    }
    std::vector<Tensor> textures =
        paintTextures(graph, net, maps, {.training = true, .dropout = preset.dropout > 0});
    for (size_t i = 0; i < samples.size(); ++i) {
        const Sample& sample = samples[i];
        VisibilityBuffer seen =
            visibilityBuffer(graph, mesh, sample.verts, sample.camera, size, size);
        // With a constant input there is one texture for the whole batch.
        const Tensor& texture = textures[preset.constantInput ? 0 : i];
        Tensor render = texturedRender(graph, seen, atlas, lights.lit(texture, sample.verts));
        // L_pt, in the region B
        Tensor region = regionOf(graph, preset.region, seen.mask, sample.mask);
        losses.term("reconstruction", preset.weight,
                    maskedL1Loss(graph, render, sample.image, region));
    }
    graph.backward(losses.sum());
    adamwStep(graph, net.parameters(), adamwOptions(preset));
    graph.compile(options);
}

}  // namespace doppel
