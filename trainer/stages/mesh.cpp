// Stage 1: the mesh refinement network G_m, trained against the masks through the soft silhouette
// (see nn/steps/mesh_step.h).
#include "nn/steps/mesh_step.h"

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
    FrameCache cache(capture);
    const bool coloured =
        preset.loss == SilhouetteLoss::Edges && preset.colour > 0 && !avatar.texels.empty();
    std::optional<BackgroundPlate> plate;
    if (coloured) plate.emplace(capture, cache);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size, coloured, 1,
                          settings.memoryBudget, plate ? &*plate : nullptr);

    Parameters net;
    declareMeshNet(net, avatar, settings.seed);
    net.allocate(device);
    MeshStep step(device, avatar.body, avatar.betas, net, preset, settings.compileOptions(),
                  avatar.texels);

    std::vector<double> weights;
    if (preset.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 17, weights);
    StageLoop loop{.stage = "mesh", .steps = stepsOf(preset, capture.size())};
    loop.follow(step.graph, step.losses);
    loop.identity = stageIdentity(avatar, "mesh");
    loop.trained = {{"net", &net}};
    loop.frameName = [&](size_t frame) { return capture.frames[frame].name; };
    loop.draw = [&] { return sampler.next(preset.batch); };
    loop.submit = [&](int64_t i, const std::vector<size_t>& drawn) {
        for (size_t k = 0; k < drawn.size(); ++k) {
            const MeshStep::Sample& sample = step.samples[k];
            size_t frame = drawn[k];
            step.graph.write(sample.theta, std::span<const float>(capture.theta[frame]));
            step.graph.write(sample.trans, std::span<const float>(capture.trans[frame]));
            const std::vector<float> mask = frames.mask(frame);
            step.graph.write(sample.target, mask);
            if (sample.scale)
                step.graph.write(sample.scale, std::vector<float>{1 / personPixels(mask)});
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
        frames.prepare(sampler.peek(preset.batch));  // meanwhile
    };
    loop.picture = [&] {
        avatar.meshNet = readWeights(net);
        writeState(device, avatar, capture, cache, settings.out);
    };
    if (loop.run(settings)) avatar.meshNet = readWeights(net);
}

void planMesh(Device& device, const Avatar& avatar, const Capture&, const TrainSettings& settings) {
    Parameters net;
    declareMeshNet(net, avatar, settings.seed);
    net.allocate(device);
    MeshStep(device, avatar.body, avatar.betas, net, avatar.preset.mesh, settings.compileOptions());
}

}  // namespace doppel
