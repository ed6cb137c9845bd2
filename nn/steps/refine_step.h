// Stage 3 of the method (Gomes et al., WACV 2022, section 3.3): the texture refinement network G_RN
// against an image discriminator D2 and a face discriminator D1. Networks, and one training step as
// one graph.
#pragma once

#include <vector>

#include "nn/nets/discriminator.h"
#include "nn/steps/texture_step.h"

namespace doppel {

// How G_RN's output y in [-1,1] and the coarse texture x_p in [0,1] make the refined one.
//
//     Clamped   x_p + y/2 within [0,1]: y = 0 gives x_p back
//     Program   (1 + x_p + y)/2, as the authors' program has it: from 0 to 1.5
CHOICES(Residual, Clamped, Program)
CHOICES(GanLoss, Log, Squares)  // L_G and L_D: log-likelihood, or least squares
CHOICES(GanMasks, Region, Own)  // what discriminators see of frame and render: B, or each in
                                // its own silhouette
CHOICES(Misalignment, Different, Rendered)  // C: where the silhouettes differ, or what is rendered
                                            // but not real

// Stage 3: the texture refinement network G_RN and its discriminators. Its textures have stage 2's
// size.
#define REFINE_NUMBERS(NUMBER, FLAG, CHOICE)                                                    \
    NUMBER(int, size, 512, 16, 4096, "side of the crops, pixels")                               \
    NUMBER(int, width, 64, 1, 512, "channels d of the U-Net's first step")                      \
    NUMBER(int, depth, 9, 2, 12, "steps down; 2^depth is textureSize / block at most")          \
    NUMBER(int, discriminatorWidth, 64, 1, 512, "channels d of the discriminators")             \
    NUMBER(int, faceSize, 80, 12, 4096, "side of the face discriminator's crops, pixels")       \
    NUMBER(int, batch, 8, 1, 256, "frames of a step")                                           \
    NUMBER(int, epochs, 40, 0, kNoLimit, "times that all frames are taken, where steps is 0")   \
    NUMBER(int, steps, 0, 0, kNoLimit, "steps, whatever the number of frames; 0: go by epochs") \
    NUMBER(double, lr, 2e-4, 1e-12, 10, "learning rate of G_RN")                                \
    NUMBER(double, lrDiscriminator, 2e-5, 0, 10, "learning rate of the discriminators")         \
    ADAMW_NUMBERS(NUMBER)                                                                       \
    NUMBER(double, dropout, .5, 0, .99, "in steps up 2 to 5; 0: none")                          \
    CHOICE(GanLoss, loss, Log, "log-likelihood; program: squares, least squares")               \
    NUMBER(double, adversarial, 1, 0, kNoLimit, "weight of each adversarial loss L_G")          \
    NUMBER(double, reconstruction, 100, 0, kNoLimit, "α1, weight of the difference in B")       \
    NUMBER(double, misaligned, 100, 0, kNoLimit, "α2, weight of the difference in C")           \
    FLAG(imageDiscriminator, true, "D2, on whole pictures")                                     \
    FLAG(faceDiscriminator, true, "D1, on faces")                                               \
    CHOICE(Region, region, Union, "B, the pixels that count; program: intersection")            \
    CHOICE(GanMasks, masks, Region,                                                             \
           "what discriminators see: B, or own silhouettes; program: own")                      \
    CHOICE(Misalignment, apart, Different,                                                      \
           "C: differing silhouettes; program: rendered, not real")                             \
    CHOICE(Residual, residual, Clamped, "x_p + y/2 within [0,1]; program: (1 + x_p + y)/2")     \
    FLAG(balanceHeadings, false, "frames are drawn evenly over 8 body headings; program: true")
struct RefinePreset {
    NUMBERS(REFINE_NUMBERS)
};

// Fresh networks; a discriminator that the preset leaves out is there, but small.
struct RefineNetworks {
    TextureUnet generator;
    PatchDiscriminator image, face;  // D2, D1

    // InputError where the sizes do not fit.
    RefineNetworks(const RefinePreset& preset, const TexturePreset& texture, uint32_t seed);
    void allocate(Device& device);
};
TextureUnetConfig refineUnetConfig(const RefinePreset& preset, const TexturePreset& texture);

// coarse [N,3,T,T] in [0,1], maps [N,1,T,T] (visibility) -> refined [N,3,T,T]. Gradients to the
// network's parameters.
Tensor refineTextures(Graph& graph, const TextureUnet& generator, const Tensor& coarse,
                      const Tensor& maps, TextureUnet::Mode mode, Residual residual);

// Where coarse textures come from: the frozen G_TN, fed with visibility maps, or one for all.
struct CoarseTexture {
    const TextureUnet* net = nullptr;
    std::vector<float> texture;  // [T,T,3], where there is no net
    std::vector<float> light;    // what lights them, and what refines them (nn/steps/light.h)
};

// One step: D1 and D2 are updated on the frames and on what G_RN paints, then G_RN against the new
// discriminators,
//
//     L_D = Σ over D of L(D(y), real) + L(D(Î), fake)
//     Σ over D of w L_G + L_r,  L_G = L(D(Î), real),  L_r = α1 ‖(I − Î) ⊗ B‖₁/‖B‖₁ + α2 ‖(Î^TN − Î)
//     ⊗ C‖₁/‖C‖₁
//
// in one recording. Means over the batch's frames; an empty B or C gives 0.
class RefineStep {
public:
    struct Sample {
        Tensor camera, verts;  // as the rasterizers take them
        Tensor image, mask;    // the frame [S,S,3] and where the person is [S,S], in [0,1]
    };
    // body: faces, UVs and their numbers. The networks are allocated and outlive the step.
    RefineStep(Device& device, const BodyModel& body, const RefinePreset& preset,
               const RefineNetworks& networks, const CoarseTexture& coarse,
               const CompileOptions& options = {});

    Graph graph;
    // reconstruction, misaligned; gan_image and gan_face, L(D(Î), real), and behind them
    // discriminator_image and discriminator_face, L_D, for the discriminators that are used.
    Losses losses{graph};
    std::vector<Sample> samples;  // of this rank's part of the batch
    Tensor faceCentres;  // [N,2] where the head's joint is in the picture: column, row, in pixels
};

}  // namespace doppel
