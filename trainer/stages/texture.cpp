// Stage 2: the coarse texture network G_TN, trained against the frames through the hard textured
// rasterizer, the mesh network frozen (see nn/steps/texture_step.h).
#include <cmath>

#include "nn/steps/texture_step.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/stages/live_state.h"
#include "trainer/stages/stage_loop.h"
#include "trainer/stages/train.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

namespace {

TextureStepConfig stepConfig(const TexturePreset& preset) {
    return {.size = preset.size,
            .batch = preset.batch,
            .weight = static_cast<float>(preset.weight),
            .dropout = preset.dropout > 0,
            .unionRegion = preset.region == "union",
            .constantInput = preset.constantInput,
            .optimiser = adamwOptions(preset.beta1, preset.beta2, preset.weightDecay)};
}

}  // namespace

void trainTexture(Device& device, Avatar& avatar, const Capture& capture,
                  const TrainSettings& settings) {
    const TexturePreset& preset = avatar.preset.texture;
    FrameCache cache(capture);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size, true, 1,
                          settings.memoryBudget);

    // The mesh network is frozen: each frame's mesh is made once.
    std::vector<std::vector<float>> verts;
    {
        AvatarRenderer renderer(device, avatar);
        for (size_t i = 0; i < capture.size(); ++i)
            verts.push_back(renderer.vertices(capture.theta[i], capture.trans[i]));
    }

    TextureNet net(device, preset, settings.seed);
    TextureStep step(
        device, avatar.body, net.unet(), stepConfig(preset),
        {.memoryBudget = settings.memoryBudget, .timestamps = settings.profileSteps > 0});
    if (settings.profileSteps > 0) printPlan("texture", step.graph, net.parameters());

    std::vector<double> weights;
    if (avatar.preset.mesh.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 29, weights);
    int64_t steps = preset.steps;
    std::vector<size_t> drawn(step.samples.size());
    StageLoop loop{.stage = "texture", .steps = steps, .columns = {"loss"}};
    loop.identity = stageIdentity(avatar, "texture");
    loop.trained = {{"net", &net.parameters()}};
    loop.statistics = {{"statistics", &net.state()}};
    loop.draw = [&] {
        for (size_t& frame : drawn) frame = sampler.next();
    };
    loop.submit = [&](int64_t i) {
        for (size_t k = 0; k < drawn.size(); ++k) {
            const TextureStep::Sample& sample = step.samples[k];
            size_t frame = drawn[k];
            step.graph.write(sample.verts, verts[frame]);
            step.graph.write(sample.image, frames.image(frame));
            step.graph.write(sample.mask, frames.mask(frame));
            step.graph.write(sample.camera, cameraValues(rasterCamera(frames.camera(frame))));
        }
        step.graph.setStep(
            stepParams(i, settings.seed, scheduledRate(preset.lr, preset.constantPart, i, steps),
                       adamwOptions(preset.beta1, preset.beta2, preset.weightDecay)));
        step.graph.submit();
        frames.prepare(sampler.peek(drawn.size()));  // meanwhile
    };
    loop.report = [&](int64_t i, int back) {
        double loss = readLoss(step.graph, step.loss, "texture", i, back);
        return StageLoop::Report{{{"loss", loss}}, {loss}};
    };
    auto paint = [&] {
        avatar.textureNet = net.weights();
        paintTexture(device, avatar);
    };
    loop.picture = [&] {
        paint();
        writeState(device, avatar, capture, cache, settings.out);
    };
    loop.profile = [&] { printProfile("texture", step.graph); };
    if (loop.run(settings)) paint();
}

}  // namespace doppel
