// The mesh refinement network around a body, and its training step (Gomes et al., WACV 2022,
// section 3.1).
//
//     L_m = λ_gl L_gl + λ_gn L_gn + L_s
//
// A body that has a surface of its own (nn/steps/surface_step.h) should not be smoothed by L_gl and
// L_gn, which the presets of such bodies set to zero: there it is the network's offsets from the
// posed body that stay small and smooth, and colours may move them as well.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "nn/nets/mesh_net.h"
#include "nn/ops/body.h"
#include "nn/ops/raster.h"
#include "nn/steps/adamw_numbers.h"
#include "nn/steps/losses.h"

namespace doppel {

CHOICE_WORDS(ClampBounds, Paper, Program, None)
// What compares silhouettes: the soft one, by its IoU, or hard samples whose edges pull, at several
// sizes (nn/ops/surface.h, pyramidLoss).
CHOICES(SilhouetteLoss, Soft, Edges)

// Stage 1: the mesh refinement network G_m.
#define MESH_NUMBERS(NUMBER, FLAG, CHOICE)                                                        \
    NUMBER(int, size, 256, 16, 4096, "side of the crops, pixels")                                 \
    NUMBER(int, blocks, 3, 1, 16, "blocks of G_m")                                                \
    NUMBER(int, layers, 6, 1, 64, "graph convolutions per block")                                 \
    NUMBER(int, hidden, 128, 4, 1024, "features per vertex")                                      \
    NUMBER(double, deviation, .01, 0, 1, "standard deviation of the first weights")               \
    NUMBER(int, batch, 4, 1, 256, "frames of a step")                                             \
    NUMBER(int, epochs, 20, 0, kNoLimit, "times that all frames are taken, where steps is 0")     \
    NUMBER(int, steps, 0, 0, kNoLimit, "steps, whatever the number of frames; 0: go by epochs")   \
    NUMBER(double, lr, 1e-4, 0, 10, "learning rate")                                              \
    ADAMW_NUMBERS(NUMBER)                                                                         \
    NUMBER(double, sigma, 1e-5, 1e-9, 1,                                                          \
           "softness of the silhouette's rim, squared NDC; program: 1e-4 at the same radius")     \
    NUMBER(double, blurRadius, 9.21024e-5, 0, 1,                                                  \
           "how far a face is felt, squared NDC: ln(1/1e-4 - 1) sigma")                           \
    NUMBER(double, laplacian, 1, 0, kNoLimit, "λ_gl, weight of the Laplacian smoothing L_gl")     \
    NUMBER(double, normal, .5, 0, kNoLimit, "λ_gn, weight of the normal consistency L_gn")        \
    NUMBER(double, silhouette, 1, 0, kNoLimit, "weight of the silhouettes' loss L_s")             \
    NUMBER(double, gradientClip, 0, 0, kNoLimit, "largest gradient norm, 0: none; program: 2")    \
    FLAG(dilateMask, false, "the mask grows by a pixel before the loss; program: true")           \
    FLAG(balanceHeadings, false, "frames are drawn evenly over 8 body headings; program: true")   \
    CHOICE(SilhouetteLoss, loss, Soft,                                                            \
           "L_s: the soft silhouette's IoU, or edges, without its bias")                          \
    NUMBER(double, colour, 0, 0, kNoLimit, "weight of the colours' loss, where there are texels") \
    NUMBER(double, stay, 0, 0, kNoLimit, "weight of small offsets from the posed body")           \
    NUMBER(double, smooth, 0, 0, kNoLimit, "weight of smooth offsets from it")                    \
    NUMBER(double, hands, 1, 1, 1e6, "times as much of it on the hands")                          \
    CHOICE(ClampBounds, clamps, Paper, "whose table of K(v) bounds the blocks' offsets")
struct MeshPreset {
    NUMBERS(MESH_NUMBERS)
};
MeshNetConfig meshNetConfig(const MeshPreset& preset);

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

// One training step over a batch of frames: forward, backward and update in one graph.
struct MeshStep {
    struct Sample {
        Tensor camera, target, theta, trans;  // kCameraShape, [S,S], [72], [3]: inputs
        // Inputs where edges are compared, else empty: one over the mask's sum [1], and the part of
        // each pixel that the frame shows [S,S].
        Tensor scale, counts;
        Tensor image, background;  // [S,S,3] inputs where colours are compared, else empty
    };
    Graph graph;
    Losses losses{
        graph};  // iou_loss or edges (L_s), colour, offsets; laplacian (L_gl), normal (L_gn)
    std::vector<Sample> samples;  // of this rank's part of the batch

    // net: as declared by addMeshNetParameters() and allocated; outlives the step. texels
    // [size,size,3]: what the body is drawn with where colours count; empty: they do not. light:
    // what lights them (nn/steps/light.h).
    MeshStep(Device& device, const BodyModel& body, const std::array<float, 10>& betas,
             const Parameters& net, const MeshPreset& preset, const CompileOptions& options = {},
             std::span<const float> texels = {}, std::span<const float> light = {});
};

}  // namespace doppel
