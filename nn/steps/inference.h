// An avatar's frame in one graph: pose in, mesh, texture and picture out.
#pragma once

#include <array>

#include "nn/steps/mesh_step.h"
#include "nn/steps/refine_step.h"
#include "nn/steps/texture_step.h"

namespace doppel {

struct InferenceConfig {
    MeshNetConfig net;
    ClampBounds clamps = ClampBounds::Paper;
    int height = 512, width = 512;          // of the picture
    Residual residual = Residual::Clamped;  // of refined textures
};

struct Inference {
    Graph graph;
    Tensor theta, trans, camera;  // inputs: [72], [3], kCameraShape
    // Outputs: camera space [V,3], m; [T,T,3]; [H,W,3], 0 where nothing is seen; [H,W].
    Tensor verts, texture, image, mask;

    // meshNet: as declared by addMeshNetParameters(); textureNet sees which side faces the camera.
    // refineNet, where there is one, refines its textures for the side that is seen. All are
    // allocated and outlive this.
    Inference(Device& device, const BodyModel& body, const std::array<float, 10>& betas,
              const Parameters& meshNet, const TextureUnet& textureNet,
              const InferenceConfig& config, const CompileOptions& options = {},
              const TextureUnet* refineNet = nullptr);
};

}  // namespace doppel
