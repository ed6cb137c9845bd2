#include "nn/steps/light.h"

#include "nn/ops/elementwise.h"
#include "nn/ops/linalg.h"
#include "nn/ops/mesh.h"

namespace doppel {

CaptureLight::CaptureLight(Graph& graph, const BodyModel& body, const RasterMesh& mesh,
                           int64_t textureSize, const Tensor& light)
    : graph_(graph),
      lit_(Lit{meshTensors(graph, meshTopology(body.faces, body.vertexCount, body.file)),
               mesh.faceVertices,
               concat(graph, graph.constant(std::vector<float>(3, 1.0f), {1, 3}), light, 0),
               texelTensors(graph, texelPlaces(body, static_cast<int>(textureSize)))}) {}

CaptureLight::CaptureLight(Graph& graph, const BodyModel& body, const RasterMesh& mesh,
                           int64_t textureSize, std::span<const float> light)
    : graph_(graph) {
    if (!light.empty())
        lit_ = CaptureLight(graph, body, mesh, textureSize, graph.constant(light, {kLightRows, 3}))
                   .lit_;
}

Tensor CaptureLight::lit(const Tensor& texture, const Tensor& verts, const Tensor& gain) const {
    CHECK(lit_ || !gain, "a gain is one of a light");
    if (!lit_) return texture;
    Tensor light = lit_->light;
    if (gain) {
        constexpr int64_t kRows = 1 + kLightRows;
        Tensor ones = graph_.constant(std::vector<float>(kRows, 1.0f), {1, kRows, 1});
        Tensor everyRow = matmul(graph_, ones, gain.reshaped({1, 1, 3}));
        light = multiply(graph_, light, everyRow.reshaped({kRows, 3}));
    }
    return litTexture(graph_, texture, light, vertexNormals(graph_, verts, lit_->topology),
                      lit_->faceVertices, lit_->texels);
}

}  // namespace doppel
