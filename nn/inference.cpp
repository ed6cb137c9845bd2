#include "nn/inference.h"

namespace doppel {

Inference::Inference(Device& device, const BodyModel& body, const std::array<float, 10>& betas,
                     const Parameters& meshNet, const TextureUnet& textureNet,
                     const InferenceConfig& config, const CompileOptions& options)
    : graph(device) {
    theta = graph.input({72});
    trans = graph.input({3});
    camera = graph.input(kCameraShape);
    Tensor beta = graph.constant(std::span<const float>(betas), {10});
    Tensor rest =
        graph.constant(std::span<const float>(body.templateVertices), {body.vertexCount, 3});
    LbsModel skin = lbsModel(graph, body);
    MeshNetwork network = meshNetwork(graph, body, config.net, config.clamps, meshNet);
    verts = network.refine(skin, rest, beta, theta, trans);

    RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
    Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
    RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);
    Tensor map = visibilityMap(graph, mesh, verts, atlas, textureNet.config().size);
    texture = paintTextures(graph, textureNet, {map}, {}).at(0);
    VisibilityBuffer seen =
        visibilityBuffer(graph, mesh, verts, camera, config.height, config.width);
    image = texturedRender(graph, seen, atlas, texture);
    mask = seen.mask;
    for (const Tensor& result : {verts, texture, image, mask}) graph.output(result);
    graph.compile(options);
}

}  // namespace doppel
