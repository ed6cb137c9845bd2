#include "trainer/stages/memory_plan.h"

#include <algorithm>
#include <string_view>

#include "engine/error.h"
#include "nn/ops/fit.h"
#include "nn/steps/fit_step.h"
#include "nn/steps/mesh_step.h"
#include "nn/steps/refine_step.h"
#include "nn/steps/texture_step.h"
#include "trainer/avatar/networks.h"

namespace doppel {

namespace {

void planFit(Device& device, const Avatar& avatar, const Capture& capture,
             const CompileOptions& options) {
    FitStart start{.poses = std::vector<float>(capture.size() * size_t(kPoseRow)),
                   .betas = capture.betas,
                   .keypoints = capture.keypoints && capture.keypoints->count > 0};
    FitStep(device, avatar.body, std::move(start), avatar.preset.fit, options);
}

void planMesh(Device& device, const Avatar& avatar, uint64_t seed, const CompileOptions& options) {
    Parameters net;
    declareMeshNet(net, avatar, seed);
    net.allocate(device);
    MeshStep(device, avatar.body, avatar.betas, net, avatar.preset.mesh, options);
}

void planTexture(Device& device, const Avatar& avatar, uint64_t seed,
                 const CompileOptions& options) {
    const TextureNet net(device, avatar.preset.texture, seed);
    TextureStep(device, avatar.body, net.unet(), avatar.preset.texture, options);
}

void planRefine(Device& device, const Avatar& avatar, uint64_t seed,
                const CompileOptions& options) {
    const Preset& preset = avatar.preset;
    const auto size = static_cast<size_t>(preset.texture.textureSize);
    const TextureNet coarseNet(device, preset.texture, seed);
    CoarseTexture coarse;
    if (preset.texture.constantInput)
        coarse.texture.resize(size * size * 3);
    else
        coarse.net = &coarseNet.unet();
    RefineNetworks nets(preset.refine, preset.texture.textureSize, static_cast<uint32_t>(seed));
    nets.allocate(device);
    RefineStep(device, avatar.body, preset.refine, nets, coarse, options);
}

}  // namespace

void requireMemory(Device& device, const Avatar& avatar, const Capture& capture,
                   const TrainSettings& settings) {
    if (settings.memoryBudget == 0) return;
    const CompileOptions options = settings.compileOptions();
    for (const std::string& stage : settings.stages) {
        try {
            if (stage == "fit") planFit(device, avatar, capture, options);
            if (stage == "mesh") planMesh(device, avatar, settings.seed, options);
            if (stage == "texture") planTexture(device, avatar, settings.seed, options);
            if (stage == "refine") planRefine(device, avatar, settings.seed, options);
        } catch (const InputError& error) {
            throwInput("--memory: stage {}: {}", stage, error.what());
        }
    }
}

}  // namespace doppel
