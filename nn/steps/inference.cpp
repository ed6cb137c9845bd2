#include "nn/steps/inference.h"

#include "nn/ops/elementwise.h"
#include "nn/ops/texture.h"

namespace doppel {

Inference::Inference(Device& device, const BodyModel& body, const std::array<float, 10>& betas,
                     const Parameters& meshNet, const TextureUnet& textureNet,
                     const InferenceConfig& config, const CompileOptions& options,
                     const TextureUnet* refineNet)
    : graph(device) {
    theta = graph.input({kThetaSize});
    trans = graph.input({3});
    camera = graph.input(kCameraShape);
    Tensor beta = graph.constant(std::span<const float>(betas), {10});
    Tensor rest = graph.constant(body.restVertices(), {body.vertexCount, 3});
    LbsModel skin = lbsModel(graph, body);
    MeshNetwork network = meshNetwork(graph, body, config.net, config.clamps, meshNet);
    verts = network.refine(skin, rest, beta, theta, trans);

    RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
    Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
    RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);
    int64_t size = textureNet.config().size;
    Tensor map = visibilityMap(graph, mesh, verts, atlas, size).reshaped({1, 1, size, size});
    constexpr TextureUnet::Mode kFrozen{.frozen = true};
    Tensor planes = scaleShift(graph, textureNet.forward(graph, map, kFrozen), 0.5f, 0.5f);
    if (refineNet)
        planes = refineTextures(graph, *refineNet, planes, map, kFrozen, config.residual);
    texture = interleave(graph, planes).at(0);
    VisibilityBuffer seen =
        visibilityBuffer(graph, mesh, verts, camera, config.height, config.width);
    image = texturedRender(graph, seen, atlas, texture);
    mask = seen.mask;
    for (const Tensor& result : {verts, texture, image, mask}) graph.output(result);
    graph.compile(options);
}

}  // namespace doppel
