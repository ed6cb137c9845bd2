// Stage 3 of the method (Gomes et al., WACV 2022, section 3.3): the texture refinement network G_RN
// against an image discriminator D2 and a face discriminator D1. Networks, and one training step as
// one graph.
#pragma once

#include <vector>

#include "nn/body/body.h"
#include "nn/nets/discriminator.h"
#include "nn/nets/texture_unet.h"
#include "nn/ops/optim.h"

namespace doppel {

// How G_RN's output y in [-1,1] and the coarse texture x_p in [0,1] make the refined one.
enum class Residual {
    Clamped,  // x_p + y/2 within [0,1]: y = 0 gives x_p back
    Program,  // (1 + x_p + y)/2, as the authors' program has it: from 0 to 1.5
};

struct RefineConfig {
    int64_t size = 512;  // of the renders
    int64_t textureSize = 512;
    int64_t width = 64;  // d of G_RN
    int64_t depth = 0;   // steps down; 0: to one pixel
    int64_t discriminatorWidth = 64;
    int64_t faceSize = 80;  // pixels of the face's crop
    int batch = 8;
    bool dropout = true;
    bool imageDiscriminator = true, faceDiscriminator = true;
    bool leastSquares = false;  // in place of the log-likelihood
    // Weights of the generator's losses: each adversarial one, α1 and α2.
    float adversarial = 1, reconstruction = 100, misaligned = 100;
    bool unionRegion = true;  // B: the union of rendered and real body, or their intersection
    bool ownMasks = false;    // discriminators see frames and renders in their own silhouettes,
                              // or both in B
    bool oneSided = false;    // C: only what is rendered but not real
    Residual residual = Residual::Clamped;
    AdamWOptions generatorOptimiser, discriminatorOptimiser;  // its rateScale: lr_D / lr_G
};

// Fresh networks; what the configuration leaves out is there, but small.
struct RefineNetworks {
    TextureUnet generator;
    PatchDiscriminator image, face;  // D2, D1

    // InputError where the sizes do not fit.
    RefineNetworks(const RefineConfig& config, uint32_t seed);
    void allocate(Device& device);
};
TextureUnetConfig refineUnetConfig(const RefineConfig& config);

// coarse [N,3,T,T] in [0,1], maps [N,1,T,T] (visibility) -> refined [N,3,T,T]. Gradients to the
// network's parameters.
Tensor refineTextures(Graph& graph, const TextureUnet& generator, const Tensor& coarse,
                      const Tensor& maps, TextureUnet::Mode mode, Residual residual);

// Where coarse textures come from: the frozen G_TN, fed with visibility maps, or one for all.
struct CoarseTexture {
    const TextureUnet* net = nullptr;
    std::vector<float> texture;  // [T,T,3], where there is no net
};

// One step: D1 and D2 are updated on the frames and on what G_RN paints, then G_RN against the new
// discriminators,
//
//     L_D = Σ over D of L(D(y), real) + L(D(Î), fake)
//     L_G = Σ over D of w L(D(Î), real) + α1 ‖(I − Î) ⊗ B‖₁/‖B‖₁ + α2 ‖(Î^TN − Î) ⊗ C‖₁/‖C‖₁
//
// in one recording. Means over the batch's frames; an empty B or C gives 0.
class RefineStep {
public:
    struct Sample {
        Tensor camera, verts;  // as the rasterizers take them
        Tensor image, mask;    // the frame [S,S,3] and where the person is [S,S], in [0,1]
    };
    // body: faces, UVs and their numbers. The networks are allocated and outlive the step.
    RefineStep(Device& device, const BodyModel& body, const RefineConfig& config,
               const RefineNetworks& networks, const CoarseTexture& coarse,
               const CompileOptions& options = {});

    Graph graph;
    std::vector<Sample> samples;
    Tensor faceCentres;  // [N,2] where the head's joint is in the picture: column, row, in pixels
    // Outputs, each []. Empty: that discriminator is left out.
    Tensor generatorLoss, reconstruction, misaligned;
    Tensor ganImage, ganFace;                      // L(D(Î), real)
    Tensor discriminatorImage, discriminatorFace;  // L_D of each
};

}  // namespace doppel
