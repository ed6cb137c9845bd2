#include "nn/steps/texture_step.h"

#include "nn/ops/elementwise.h"
#include "nn/ops/fit.h"
#include "nn/ops/loss.h"
#include "nn/ops/texture.h"

namespace doppel {

namespace {

// a + b - a b: the union of two masks.
Tensor unite(Graph& graph, const Tensor& a, const Tensor& b) {
    return add(graph, add(graph, a, b), scaleShift(graph, multiply(graph, a, b), -1, 0));
}

}  // namespace

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
                         const TextureStepConfig& config, const CompileOptions& options)
    : graph(device) {
    int64_t size = config.size, texels = net.config().size;
    RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
    Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
    RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);

    // The network sees the whole batch at once, so its batch statistics are the batch's.
    std::vector<Tensor> maps;
    for (int i = 0; i < config.batch; ++i) {
        Sample sample{graph.input(kCameraShape), graph.input({body.vertexCount, 3}),
                      graph.input({size, size, 3}), graph.input({size, size})};
        if (!config.constantInput)
            maps.push_back(visibilityMap(graph, mesh, sample.verts, atlas, texels));
        samples.push_back(sample);
    }
    std::vector<Tensor> textures =
        paintTextures(graph, net, maps, {.training = true, .dropout = config.dropout});
    for (size_t i = 0; i < samples.size(); ++i) {
        const Sample& sample = samples[i];
        VisibilityBuffer seen =
            visibilityBuffer(graph, mesh, sample.verts, sample.camera, size, size);
        // With a constant input there is one texture for the whole batch.
        const Tensor& texture = textures[config.constantInput ? 0 : i];
        Tensor render = texturedRender(graph, seen, atlas, texture);
        Tensor region = config.unionRegion ? unite(graph, seen.mask, sample.mask)
                                           : multiply(graph, seen.mask, sample.mask);
        Tensor term = maskedL1Loss(graph, render, sample.image, region);
        float weight = config.weight / static_cast<float>(config.batch);
        loss = loss ? weightedSum(graph, {{loss, 1}, {term, weight}})
                    : weightedSum(graph, {{term, weight}});
    }
    graph.backward(loss);
    adamwStep(graph, net.parameters(), config.optimiser);
    graph.output(loss);
    graph.compile(options);
}

}  // namespace doppel
