// Stage 1: the mesh refinement network G_m, trained against the masks through the soft silhouette
// (see nn/mesh_step.h).
#include <cmath>
#include <optional>

#include "nn/mesh_step.h"
#include "trainer/checkpoint.h"
#include "trainer/networks.h"
#include "trainer/progress.h"
#include "trainer/train.h"
#include "trainer/training_frames.h"

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
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size, false);

    Parameters net;
    declareMeshNet(net, avatar, settings.seed);
    net.allocate(device);
    MeshStep step(
        device, avatar.body, avatar.betas, net, stepConfig(preset),
        {.memoryBudget = settings.memoryBudget, .timestamps = settings.profileSteps > 0});
    if (settings.profileSteps > 0) {
        printPlan("mesh", step.graph, net);
    }

    int64_t perEpoch = (static_cast<int64_t>(capture.size()) + preset.batch - 1) / preset.batch;
    int64_t steps = preset.steps > 0 ? preset.steps : preset.epochs * perEpoch;
    std::vector<double> weights;
    if (preset.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 17, weights);
    Checkpoint checkpoint(settings.out / "checkpoints", "mesh", avatar, settings.seed, steps);
    int64_t first = settings.resume ? checkpoint.restore(net) : 0;
    for (int64_t i = 0; i < first * preset.batch; ++i) sampler.next();

    Progress progress("mesh", settings.profileSteps > 0 ? settings.profileSteps : steps);
    std::optional<LossLog> log;
    if (settings.profileSteps == 0)
        log.emplace(settings.out / "log", "mesh",
                    std::vector<std::string>{"loss", "iou_loss", "laplacian", "normal"}, first);
    PictureClock pictures(settings.pictureSeconds);
    for (int64_t i = first; i < steps; ++i) {
        for (const MeshStep::Sample& sample : step.samples) {
            size_t frame = sampler.next();
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
        step.graph.run();
        double loss = readLoss(step.graph, step.loss, "mesh", i);
        double iou = readLoss(step.graph, step.iouLoss, "mesh", i);
        progress.update(i + 1, {{"loss", loss}, {"iou", 1 - iou}});
        if (settings.profileSteps > 0) {
            if (i + 1 == settings.profileSteps) {
                printProfile("mesh", step.graph);
                return;
            }
            continue;
        }
        log->add(i, {loss, iou, readLoss(step.graph, step.laplacian, "mesh", i),
                     readLoss(step.graph, step.normal, "mesh", i)});
        if (pictures.due()) {
            avatar.meshNet = readWeights(net);
            writeStatePicture(device, avatar, capture, cache, settings.out / "progress.png");
        }
        if (interrupted()) {
            checkpoint.save(net, i + 1);
            throw Interrupted{"checkpoint " + checkpoint.path().string()};
        }
        checkpoint.saveIfDue(net, i + 1);
    }
    avatar.meshNet = readWeights(net);
    checkpoint.remove();
}

}  // namespace doppel
