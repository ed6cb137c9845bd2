// Stage 1: the mesh refinement network G_m, trained against the masks through the soft silhouette
// (see nn/steps/mesh_step.h).
#include <cmath>

#include "nn/steps/mesh_step.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/stages/live_state.h"
#include "trainer/stages/stage_loop.h"
#include "trainer/stages/train.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

namespace {

MeshStepConfig stepConfig(const MeshPreset& preset) {
    auto f = [](double value) { return static_cast<float>(value); };
    return {.net = meshNetConfig(preset),
            .clamps = clampsOf(preset),
            .size = preset.size,
            .batch = preset.batch,
            .silhouette = f(preset.silhouette),
            .laplacian = f(preset.laplacian),
            .normal = f(preset.normal),
            .gradientClip = f(preset.gradientClip),
            .dilateMask = preset.dilateMask,
            .optimiser = adamwOptions(preset.beta1, preset.beta2, preset.weightDecay)};
}

}  // namespace

void trainMesh(Device& device, Avatar& avatar, const Capture& capture,
               const TrainSettings& settings) {
    const MeshPreset& preset = avatar.preset.mesh;
    FrameCache cache(capture);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size, false, 1,
                          settings.memoryBudget);

    Parameters net;
    declareMeshNet(net, avatar, settings.seed);
    net.allocate(device);
    MeshStep step(device, avatar.body, avatar.betas, net, stepConfig(preset),
                  {.memoryBudget = settings.memoryBudget, .timestamps = settings.profileSteps > 0});
    if (settings.profileSteps > 0) {
        printPlan("mesh", step.graph, net);
    }

    int64_t perEpoch = (static_cast<int64_t>(capture.size()) + preset.batch - 1) / preset.batch;
    int64_t steps = preset.steps > 0 ? preset.steps : preset.epochs * perEpoch;
    std::vector<double> weights;
    if (preset.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 17, weights);
    std::vector<size_t> drawn(step.samples.size());
    StageLoop loop{
        .stage = "mesh", .steps = steps, .columns = {"loss", "iou_loss", "laplacian", "normal"}};
    loop.identity = stageIdentity(avatar, "mesh");
    loop.trained = {{"net", &net}};
    loop.draw = [&] {
        for (size_t& frame : drawn) frame = sampler.next();
    };
    loop.submit = [&](int64_t i) {
        for (size_t k = 0; k < drawn.size(); ++k) {
            const MeshStep::Sample& sample = step.samples[k];
            size_t frame = drawn[k];
            step.graph.write(sample.theta, std::span<const float>(capture.theta[frame]));
            step.graph.write(sample.trans, std::span<const float>(capture.trans[frame]));
            step.graph.write(sample.target, frames.mask(frame));
            step.graph.write(
                sample.camera,
                cameraValues(rasterCamera(frames.camera(frame), preset.sigma, preset.blurRadius)));
        }
        step.graph.setStep(
            stepParams(i, settings.seed, scheduledRate(preset.lr, preset.constantPart, i, steps),
                       adamwOptions(preset.beta1, preset.beta2, preset.weightDecay)));
        step.graph.submit();
        frames.prepare(sampler.peek(drawn.size()));  // meanwhile
    };
    loop.report = [&](int64_t i, int back) {
        auto read = [&](const Tensor& loss) { return readLoss(step.graph, loss, "mesh", i, back); };
        double loss = read(step.loss), iou = read(step.iouLoss);
        return StageLoop::Report{{{"loss", loss}, {"iou", 1 - iou}},
                                 {loss, iou, read(step.laplacian), read(step.normal)}};
    };
    loop.picture = [&] {
        avatar.meshNet = readWeights(net);
        writeState(device, avatar, capture, cache, settings.out);
    };
    loop.profile = [&] { printProfile("mesh", step.graph); };
    if (loop.run(settings)) avatar.meshNet = readWeights(net);
}

}  // namespace doppel
