// The mesh refinement network around a body, and its training step (Gomes et al., WACV 2022,
// section 3.1).
//
//     L_m = λ_gl L_gl + λ_gn L_gn + L_s
#pragma once

#include <array>
#include <vector>

#include "nn/body/body.h"
#include "nn/nets/mesh_net.h"
#include "nn/ops/body.h"
#include "nn/ops/optim.h"
#include "nn/ops/raster.h"

namespace doppel {

// G_m on a graph, with what goes before and after it.
struct MeshNetwork {
    Graph* graph;
    MeshTensors mesh;
    MeshNet net;
    Tensor bodyPose;  // [72] ones, but zeros for the global orientation
    Tensor origin;    // [3] zeros

    // The body posed without global orientation, refined, and put where theta and trans say:
    // M = R(θ_0) (G_m(P) − j_0) + j_0 + t, in camera space [V,3].
    Tensor refine(const LbsModel& skin, const Tensor& rest, const Tensor& beta, const Tensor& theta,
                  const Tensor& trans) const;

    // The same without gradients, for a body that is posed again and again: with the network's
    // weights and the shape in a graph's preparation, and, where the network takes rows, for no
    // more than what `rows` lists.
    Tensor refine(const LbsModel& skin, const ShapedBody& shaped, const Tensor& theta,
                  const Tensor& trans, const MovedRows* rows = nullptr) const;
};
// parameters: as declared by addMeshNetParameters() and allocated.
MeshNetwork meshNetwork(Graph& graph, const BodyModel& body, const MeshNetConfig& config,
                        ClampBounds clamps, const Parameters& parameters);

struct MeshStepConfig {
    MeshNetConfig net;
    ClampBounds clamps = ClampBounds::Paper;
    int size = 256, batch = 4;                          // side of the silhouettes, pixels; frames
    float silhouette = 1, laplacian = 1, normal = .5f;  // weights of the losses
    float gradientClip = 0;                             // largest gradient norm; 0: none
    bool dilateMask = false;                            // 3x3 before the loss
    AdamWOptions optimiser;
};

// One training step over a batch of frames: forward, backward and update in one graph.
struct MeshStep {
    struct Sample {
        Tensor camera, target, theta, trans;  // kCameraShape, [S,S], [72], [3]: inputs
    };
    Graph graph;
    std::vector<Sample> samples;
    Tensor loss, iouLoss, laplacian, normal;  // outputs, means over the batch

    // net: as declared by addMeshNetParameters() and allocated; outlives the step.
    MeshStep(Device& device, const BodyModel& body, const std::array<float, 10>& betas,
             const Parameters& net, const MeshStepConfig& config,
             const CompileOptions& options = {});
};

}  // namespace doppel
