// The coarse texture network's training step (Gomes et al., WACV 2022, section 3.2).
//
//     L_pt = ‖(Î − I) ⊗ B‖₁ / ‖B‖₁
#pragma once

#include <vector>

#include "nn/body/body.h"
#include "nn/nets/texture_unet.h"
#include "nn/ops/raster.h"
#include "nn/steps/adamw_numbers.h"
#include "nn/steps/losses.h"

namespace doppel {

// B, the pixels that the colours' losses count: the union of the rendered and the real body, or
// their intersection.
CHOICES(Region, Union, Intersection)

// The least side of a texture whose size goes by the frames.
inline constexpr int kLeastSideByFrames = 512;

// Stage 2: the coarse texture network G_TN.
#define TEXTURE_NUMBERS(NUMBER, FLAG, CHOICE)                                                 \
    NUMBER(int, size, 512, 16, 4096, "side of the crops, pixels")                             \
    NUMBER(int, textureSize, 512, 0, 4096,                                                    \
           "side of the textures, texels; a power of two from 16 on; 0: by the frames")       \
    NUMBER(double, texel, 1, .1, 100,                                                         \
           "pixels that a texel covers at most, where textureSize goes by the frames")        \
    NUMBER(int, block, 1, 1, 8, "texels of a side that the networks take as one")             \
    NUMBER(int, width, 64, 1, 512, "channels d of the U-Net's first step")                    \
    NUMBER(int, depth, 9, 2, 12, "steps down; 2^depth is textureSize / block at most")        \
    NUMBER(int, batch, 8, 1, 256, "frames of a step")                                         \
    NUMBER(int, steps, 2000, 0, kNoLimit, "steps, whatever the number of frames")             \
    NUMBER(double, lr, 2e-3, 0, 10, "learning rate")                                          \
    NUMBER(double, lrOver, 2e-4, 0, 10, "learning rate of a network that paints over texels") \
    ADAMW_NUMBERS(NUMBER)                                                                     \
    NUMBER(double, weight, 1, 0, kNoLimit, "weight of L_pt; program: 100")                    \
    NUMBER(double, dropout, .5, 0, .99, "in steps up 2 to 5; 0: none")                        \
    CHOICE(Region, region, Union, "B, the pixels that count; program: intersection")          \
    FLAG(constantInput, false, "all ones in place of the visibility map x_v; program: true")
struct TexturePreset {
    NUMBERS(TEXTURE_NUMBERS)
};

// a + b - a b, or a b: the masks' union or intersection.
Tensor regionOf(Graph& graph, Region region, const Tensor& a, const Tensor& b);

// G_TN: visibility maps [size,size] of a batch in, textures [size,size,3] in [0,1] out, one per
// map. No maps: a map of ones, which paints all sides at once.
std::vector<Tensor> paintTextures(Graph& graph, const TextureUnet& net,
                                  const std::vector<Tensor>& maps, TextureUnet::Mode mode);

// One training step over a batch of frames: forward, backward and update in one graph.
struct TextureStep {
    struct Sample {
        Tensor camera, verts, image, mask;  // kCameraShape, [V,3], [S,S,3], [S,S]: inputs
    };
    Graph graph;
    Losses losses{graph};         // reconstruction (L_pt)
    std::vector<Sample> samples;  // of this rank's part of the batch

    // net: allocated; outlives the step. light: what lights what it paints (nn/steps/light.h).
    TextureStep(Device& device, const BodyModel& body, const TextureUnet& net,
                const TexturePreset& preset, const CompileOptions& options = {},
                std::span<const float> light = {});
};

}  // namespace doppel
