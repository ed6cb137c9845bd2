// The coarse texture network's training step (Gomes et al., WACV 2022, section 3.2).
//
//     L_pt = ‖(Î − I) ⊗ B‖₁ / ‖B‖₁
#pragma once

#include <vector>

#include "nn/body/body.h"
#include "nn/nets/texture_unet.h"
#include "nn/ops/optim.h"
#include "nn/ops/raster.h"

namespace doppel {

// G_TN: visibility maps [size,size] of a batch in, textures [size,size,3] in [0,1] out, one per
// map. No maps: a map of ones, which paints all sides at once.
std::vector<Tensor> paintTextures(Graph& graph, const TextureUnet& net,
                                  const std::vector<Tensor>& maps, TextureUnet::Mode mode);

struct TextureStepConfig {
    int size = 512, batch = 8;  // side of the renders, pixels; frames
    float weight = 1;           // of L_pt
    bool dropout = true;
    bool unionRegion = true;     // B: union of rendered and real body; false: their intersection
    bool constantInput = false;  // all ones in place of the visibility map
    AdamWOptions optimiser;
};

// One training step over a batch of frames: forward, backward and update in one graph.
struct TextureStep {
    struct Sample {
        Tensor camera, verts, image, mask;  // kCameraShape, [V,3], [S,S,3], [S,S]: inputs
    };
    Graph graph;
    std::vector<Sample> samples;
    Tensor loss;  // output

    // net: allocated; outlives the step.
    TextureStep(Device& device, const BodyModel& body, const TextureUnet& net,
                const TextureStepConfig& config, const CompileOptions& options = {});
};

}  // namespace doppel
