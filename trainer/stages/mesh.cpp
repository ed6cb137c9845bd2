// Stage 1: the mesh refinement network G_m, trained against the masks, and the colours where there
// are texels (see nn/steps/mesh_step.h).
#include "nn/steps/mesh_step.h"

#include <algorithm>
#include <optional>

#include "trainer/avatar/background.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/stages/live_state.h"
#include "trainer/stages/stage.h"
#include "trainer/stages/stage_loop.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

void trainMesh(Device& device, TrainResult& result, const TrainSettings& settings) {
    Avatar& avatar = result.avatar;
    const Capture& capture = result.capture;
    const MeshPreset& preset = avatar.preset.mesh;
    Ranks* sharing = settings.sharing(preset.batch);
    FrameCache cache(capture);
    Parameters net;
    declareMeshNet(net, avatar, settings.seed);
    net.allocate(device);
    MeshStep step(device, avatar.body, avatar.betas, net, preset, settings.compileOptions(sharing),
                  avatar.texels, avatar.light);
    const MeshStep::Sample& first = step.samples.at(0);
    const bool coloured = static_cast<bool>(first.image);
    std::optional<BackgroundPlates> scene;
    if (coloured) scene.emplace(capture, cache, settings.ranks);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size,
                          {.colours = coloured,
                           .memoryBudget = settings.memoryBudget,
                           .edges = static_cast<bool>(first.scale),
                           .rim = coloured ? avatar.preset.texels.rim : 0,
                           .scene = scene ? &*scene : nullptr,
                           .ranks = settings.ranks});

    std::vector<double> weights;
    if (preset.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 17, weights);
    StageLoop loop{.stage = "mesh", .steps = stepsOf(preset, capture.size())};
    loop.follow(step.graph, step.losses);
    loop.sharing = sharing;
    loop.identity = stageIdentity(avatar, "mesh");
    loop.trained = {{"net", &net}};
    loop.frameName = [&](size_t frame) { return capture.frames[frame].name; };
    loop.draw = [&] { return sampler.next(preset.batch); };
    loop.submit = [&](int64_t i, const std::vector<size_t>& drawn) {
        const std::span<const size_t> mine = partOf(sharing, drawn);
        for (size_t k = 0; k < mine.size(); ++k) {
            const MeshStep::Sample& sample = step.samples[k];
            size_t frame = mine[k];
            step.graph.write(sample.theta, std::span<const float>(capture.theta[frame]));
            step.graph.write(sample.trans, std::span<const float>(capture.trans[frame]));
            step.graph.write(sample.target, frames.mask(frame));
            if (sample.scale) {
                step.graph.write(sample.scale, std::vector<float>{frames.scale(frame)});
                step.graph.write(sample.counts, frames.inside(frame));
            }
            if (sample.image) {
                step.graph.write(sample.image, frames.image(frame));
                step.graph.write(sample.background, frames.background(frame));
            }
            step.graph.write(
                sample.camera,
                cameraValues(rasterCamera(frames.camera(frame), preset.sigma, preset.blurRadius)));
        }
        step.graph.setStep(stepParams(preset, i, loop.steps, settings.seed));
        step.graph.submit();
        frames.prepare(partOf(sharing, sampler.peek(preset.batch)));  // meanwhile
    };
    loop.picture = [&] {
        avatar.meshNet = readWeights(net);
        writeState(device, avatar, capture, cache, settings.out);
    };
    if (loop.run(settings)) avatar.meshNet = readWeights(net);
}

void planMesh(Device& device, const Avatar& avatar, const Capture&, const TrainSettings& settings) {
    // Colours count where texels are there, or will be.
    std::vector<float> texels = avatar.texels;
    if (std::ranges::count(settings.stages, "texels") > 0) {
        const auto size = static_cast<size_t>(avatar.preset.texture.textureSize);
        texels.resize(3 * size * size);
    }
    Parameters net;
    declareMeshNet(net, avatar, settings.seed);
    net.allocate(device);
    MeshStep(device, avatar.body, avatar.betas, net, avatar.preset.mesh,
             settings.compileOptions(settings.sharing(avatar.preset.mesh.batch)), texels,
             plannedLight(avatar, settings));
}

}  // namespace doppel
