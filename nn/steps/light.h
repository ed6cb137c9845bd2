// The light that a capture was recorded under, as far as what it lights tells: a factor on a
// texel's colour for each way in which the surface may face the camera,
//
//     s_c(n) = 1 + sum_k L_kc Y_k(n),  k = 1 to 8, n in camera space,
//
// with the spherical harmonics of shaders/texture/lit_texture.comp. What light does on average over
// all directions stays in the texels. The light goes with the camera: people who turn before a
// camera that stands still show it.
#pragma once

#include <optional>
#include <span>

#include "nn/body/body.h"
#include "nn/body/mesh_topology.h"
#include "nn/ops/raster.h"
#include "nn/ops/texture.h"

namespace doppel {

inline constexpr int64_t kLightRows = 8;
inline constexpr size_t kLightNumbers = 3 * kLightRows;  // L [8,3]

class CaptureLight {
public:
    // mesh: of the body's faces. light: L; an empty span: none, and textures are left as they are.
    CaptureLight(Graph& graph, const BodyModel& body, const RasterMesh& mesh, int64_t textureSize,
                 std::span<const float> light);
    // L [8,3] is a tensor of the graph, such as a parameter.
    CaptureLight(Graph& graph, const BodyModel& body, const RasterMesh& mesh, int64_t textureSize,
                 const Tensor& light);

    // The texture [T,T,3] as the camera sees it on a body with these vertices [V,3] in camera
    // space, times what the picture's exposure and white balance make of it, where there is a
    // gain [3]. Gradients to the texture, to L and to the gain, none to the vertices.
    Tensor lit(const Tensor& texture, const Tensor& verts, const Tensor& gain = {}) const;

private:
    struct Lit {
        MeshTensors topology;
        Tensor faceVertices, light;  // [F,4], [9,3]
        TexelTensors texels;
    };
    Graph& graph_;
    std::optional<Lit> lit_;
};

}  // namespace doppel
