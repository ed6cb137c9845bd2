// How cost grows: with faces and pixels for the rasterizers, with vertices and batch for the steps.
#include "nn/ops/raster.h"
#include "nn/tools/bench.h"

namespace doppel::bench {

namespace {

enum class Raster { Silhouette, Render, Map };

// Forward and backward (where there is one) of a rasterizer on a ball that fills a sixth of the
// picture.
Recording rasterize(Raster what, int64_t faces, int64_t size) {
    struct Owner {
        BodyModel body;
        std::unique_ptr<Graph> graph;
    };
    auto owner = std::make_shared<Owner>();
    owner->body = ballBody(faces / 2);
    const BodyModel& body = owner->body;
    std::vector<float> at = standingVerts(body);
    owner->graph = std::make_unique<Graph>(device());
    Graph& graph = *owner->graph;
    auto random = [&](Shape shape) {
        std::vector<float> values = randomValues(elementCount(shape), 3);
        return graph.constant(std::span<const float>(values), std::move(shape));
    };
    Tensor verts = graph.constant(std::span<const float>(at), {body.vertexCount, 3});
    std::vector<float> cameraIs = standingCamera(size);
    Tensor camera = graph.constant(std::span<const float>(cameraIs), kCameraShape);
    RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
    Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
    RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);
    double bytes = static_cast<double>(body.vertexCount * 12 + body.faceCount * 12);
    auto pixels = static_cast<double>(size * size);
    switch (what) {
        case Raster::Silhouette: {
            graph.watch(verts);
            Tensor seen = softSilhouette(graph, mesh, verts, camera, size, size);
            graph.backward({{seen, random(seen.shape)}});
            bytes = 2 * bytes + 8 * pixels + static_cast<double>(verts.bytes());
            break;
        }
        case Raster::Render: {
            Tensor texture = random({size, size, 3});
            graph.watch(texture);
            VisibilityBuffer seen = visibilityBuffer(graph, mesh, verts, camera, size, size);
            Tensor image = texturedRender(graph, seen, atlas, texture);
            graph.backward({{image, random(image.shape)}});
            bytes += 4 * 12 * pixels;
            break;
        }
        case Raster::Map:
            visibilityMap(graph, mesh, verts, atlas, size);
            bytes += 4 * pixels;
            break;
    }
    graph.compile({.timestamps = true});
    return {owner, &graph, Recording::Part::Whole, bytes};
}

}  // namespace

// Of bench_steps.cpp.
Recording meshStep(const BodyModel& body, int batch);
Recording textureStep(const BodyModel& body, int batch);

void addGrowth() {
    constexpr std::pair<Raster, const char*> kRasters[] = {{Raster::Silhouette, "soft_silhouette"},
                                                           {Raster::Render, "textured_render"},
                                                           {Raster::Map, "visibility_map"}};
    for (auto [raster, name] : kRasters)
        for (int64_t faces : {7'000, 70'000, 700'000})
            for (int64_t size : {256, 512, 1024, 2048})
                add(fmt::format("grow/{}/faces:{}/pixels:{}", name, faces, size),
                    [raster, faces, size] { return rasterize(raster, faces, size); });
    for (int64_t vertices : {2'000, 8'000, 32'000, 128'000})
        add(fmt::format("grow/mesh_step/vertices:{}", vertices),
            [vertices] { return meshStep(ballBody(vertices), 1); });
    for (int batch : {1, 2, 4, 8})
        add(fmt::format("grow/mesh_step/batch:{}", batch),
            [batch] { return meshStep(defaultBody(), batch); });
    for (int64_t vertices : {2'000, 8'000, 32'000, 128'000})
        add(fmt::format("grow/texture_step/vertices:{}", vertices),
            [vertices] { return textureStep(ballBody(vertices), 1); });
    for (int batch : {1, 2, 4, 8})
        add(fmt::format("grow/texture_step/batch:{}", batch),
            [batch] { return textureStep(defaultBody(), batch); });
}

}  // namespace doppel::bench
