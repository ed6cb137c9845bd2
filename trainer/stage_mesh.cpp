// Stage 1: the mesh refinement network G_m (Gomes et al., WACV 2022, section 3.1), trained against
// the masks through the soft silhouette.
//
//     L_m = λ_gl L_gl + λ_gn L_gn + L_s
#include <cmath>
#include <optional>

#include "nn/fit.h"
#include "nn/lbs.h"
#include "nn/loss.h"
#include "nn/mesh_net.h"
#include "nn/mesh_ops.h"
#include "nn/optim.h"
#include "nn/raster.h"
#include "trainer/checkpoint.h"
#include "trainer/networks.h"
#include "trainer/progress.h"
#include "trainer/train.h"
#include "trainer/training_frames.h"

namespace doppel {

namespace {

// One training step over a batch of frames.
struct MeshStep {
    struct Sample {
        Tensor camera, target, theta, trans;
    };
    Graph graph;
    std::vector<Sample> samples;
    Tensor loss, iouLoss, laplacian, normal;

    MeshStep(Device& device, const Avatar& avatar, const Parameters& net, uint64_t memoryBudget,
             bool timestamps)
        : graph(device) {
        const MeshPreset& preset = avatar.preset.mesh;
        const BodyModel& body = avatar.body;
        MeshNetwork network = meshNetwork(graph, avatar, net);
        LbsModel skin = lbsModel(graph, body);
        Tensor rest =
            graph.constant(std::span<const float>(body.templateVertices), {body.vertexCount, 3});
        Tensor beta = graph.constant(std::span<const float>(avatar.betas), {10});
        RasterMesh faces = rasterMesh(graph, body.faces, body.vertexCount);
        float share = 1.0f / static_cast<float>(preset.batch);
        for (int i = 0; i < preset.batch; ++i) {
            Sample sample{graph.input(kCameraShape), graph.input({preset.size, preset.size}),
                          graph.input({72}), graph.input({3})};
            Tensor verts = network.refine(skin, rest, beta, sample.theta, sample.trans);
            Tensor silhouette =
                softSilhouette(graph, faces, verts, sample.camera, preset.size, preset.size);
            Tensor mask = preset.dilateMask ? dilate3(graph, sample.target) : sample.target;
            Tensor iou = silhouetteIouLoss(graph, silhouette, mask);
            Tensor smooth = laplacianLoss(graph, verts, network.mesh);
            Tensor bend = normalConsistencyLoss(graph, verts, network.mesh);
            std::vector<WeightedTerm> terms{{iou, share * static_cast<float>(preset.silhouette)},
                                            {smooth, share * static_cast<float>(preset.laplacian)},
                                            {bend, share * static_cast<float>(preset.normal)}};
            if (loss) terms.push_back({loss, 1});
            loss = weightedSum(graph, terms);
            auto add = [&](Tensor& sum, const Tensor& term) {
                sum = sum ? weightedSum(graph, {{sum, 1}, {term, share}})
                          : weightedSum(graph, {{term, share}});
            };
            add(iouLoss, iou);
            add(laplacian, smooth);
            add(normal, bend);
            samples.push_back(sample);
        }
        graph.backward(loss);
        if (preset.gradientClip > 0)
            clipGradientNorm(graph, net, static_cast<float>(preset.gradientClip));
        adamwStep(graph, net, adamwOptions(preset.beta1, preset.beta2, preset.weightDecay));
        for (const Tensor& value : {loss, iouLoss, laplacian, normal}) graph.output(value);
        graph.compile({.memoryBudget = memoryBudget, .timestamps = timestamps});
    }
};

}  // namespace

void trainMesh(Device& device, Avatar& avatar, const Capture& capture,
               const TrainSettings& settings) {
    const MeshPreset& preset = avatar.preset.mesh;
    FrameCache cache(capture);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size, false);

    Parameters net;
    declareMeshNet(net, avatar, settings.seed);
    net.allocate(device);
    MeshStep step(device, avatar, net, settings.memoryBudget, settings.profileSteps > 0);
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
