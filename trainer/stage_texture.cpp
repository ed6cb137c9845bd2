// Stage 2: the coarse texture network G_TN (Gomes et al., WACV 2022, section 3.2), trained against
// the frames through the hard textured rasterizer, the mesh network frozen.
//
//     L_pt = ‖(Î − I) ⊗ B‖₁ / ‖B‖₁
#include <cmath>
#include <optional>

#include "nn/elementwise.h"
#include "nn/fit.h"
#include "nn/loss.h"
#include "nn/optim.h"
#include "nn/raster.h"
#include "nn/texture_unet.h"
#include "trainer/checkpoint.h"
#include "trainer/networks.h"
#include "trainer/progress.h"
#include "trainer/train.h"
#include "trainer/training_frames.h"

namespace doppel {

namespace {

// a + b - a b: the union of two masks.
Tensor unite(Graph& graph, const Tensor& a, const Tensor& b) {
    return add(graph, add(graph, a, b), scaleShift(graph, multiply(graph, a, b), -1, 0));
}

struct TextureStep {
    struct Sample {
        Tensor camera, verts, image, mask;
    };
    Graph graph;
    std::vector<Sample> samples;
    Tensor loss;

    TextureStep(Device& device, const Avatar& avatar, TextureNet& net, uint64_t memoryBudget,
                bool timestamps)
        : graph(device) {
        const TexturePreset& preset = avatar.preset.texture;
        const BodyModel& body = avatar.body;
        int64_t size = preset.size, texels = preset.textureSize;
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
        RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);

        // The network sees the whole batch at once, so its batch statistics are the batch's.
        std::vector<Tensor> maps;
        for (int i = 0; i < preset.batch; ++i) {
            Sample sample{graph.input(kCameraShape), graph.input({body.vertexCount, 3}),
                          graph.input({size, size, 3}), graph.input({size, size})};
            if (!preset.constantInput)
                maps.push_back(visibilityMap(graph, mesh, sample.verts, atlas, texels));
            samples.push_back(sample);
        }
        std::vector<Tensor> textures = net.forward(graph, maps, true);
        for (size_t i = 0; i < samples.size(); ++i) {
            const Sample& sample = samples[i];
            VisibilityBuffer seen =
                visibilityBuffer(graph, mesh, sample.verts, sample.camera, size, size);
            // With a constant input there is one texture for the whole batch.
            const Tensor& texture = textures[preset.constantInput ? 0 : i];
            Tensor render = texturedRender(graph, seen, atlas, texture);
            Tensor region = preset.region == "union" ? unite(graph, seen.mask, sample.mask)
                                                     : multiply(graph, seen.mask, sample.mask);
            Tensor term = maskedL1Loss(graph, render, sample.image, region);
            float weight = static_cast<float>(preset.weight) / static_cast<float>(preset.batch);
            loss = loss ? weightedSum(graph, {{loss, 1}, {term, weight}})
                        : weightedSum(graph, {{term, weight}});
        }
        graph.backward(loss);
        adamwStep(graph, net.parameters(),
                  adamwOptions(preset.beta1, preset.beta2, preset.weightDecay));
        graph.output(loss);
        graph.compile({.memoryBudget = memoryBudget, .timestamps = timestamps});
    }
};

}  // namespace

void trainTexture(Device& device, Avatar& avatar, const Capture& capture,
                  const TrainSettings& settings) {
    const TexturePreset& preset = avatar.preset.texture;
    FrameCache cache(capture);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size, true);

    // The mesh network is frozen: each frame's mesh is made once.
    std::vector<std::vector<float>> verts;
    {
        AvatarRenderer renderer(device, avatar);
        for (size_t i = 0; i < capture.size(); ++i)
            verts.push_back(renderer.vertices(capture.theta[i], capture.trans[i]));
    }

    TextureNet net(device, preset, settings.seed);
    TextureStep step(device, avatar, net, settings.memoryBudget, settings.profileSteps > 0);
    if (settings.profileSteps > 0) printPlan("texture", step.graph, net.parameters());

    std::vector<double> weights;
    if (avatar.preset.mesh.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 29, weights);
    int64_t steps = preset.steps;
    Checkpoint checkpoint(settings.out / "checkpoints", "texture", avatar, settings.seed, steps);
    int64_t first = settings.resume ? checkpoint.restore(net.parameters(), &net.state()) : 0;
    for (int64_t i = 0; i < first * preset.batch; ++i) sampler.next();

    Progress progress("texture", settings.profileSteps > 0 ? settings.profileSteps : steps);
    std::optional<LossLog> log;
    if (settings.profileSteps == 0)
        log.emplace(settings.out / "log", "texture", std::vector<std::string>{"loss"}, first);
    PictureClock pictures(settings.pictureSeconds);
    for (int64_t i = first; i < steps; ++i) {
        for (const TextureStep::Sample& sample : step.samples) {
            size_t frame = sampler.next();
            step.graph.write(sample.verts, verts[frame]);
            step.graph.write(sample.image, frames.image(frame));
            step.graph.write(sample.mask, frames.mask(frame));
            step.graph.write(sample.camera, cameraValues(rasterCamera(frames.camera(frame))));
        }
        step.graph.setStep(
            stepParams(i, settings.seed, scheduledRate(preset.lr, preset.constantPart, i, steps),
                       adamwOptions(preset.beta1, preset.beta2, preset.weightDecay)));
        step.graph.run();
        double loss = readLoss(step.graph, step.loss, "texture", i);
        progress.update(i + 1, {{"loss", loss}});
        if (settings.profileSteps > 0) {
            if (i + 1 == settings.profileSteps) {
                printProfile("texture", step.graph);
                return;
            }
            continue;
        }
        log->add(i, {loss});
        if (pictures.due()) {
            avatar.textureNet = net.weights();
            paintTexture(device, avatar);
            writeStatePicture(device, avatar, capture, cache, settings.out / "progress.png");
        }
        if (interrupted()) {
            checkpoint.save(net.parameters(), i + 1, &net.state());
            throw Interrupted{"checkpoint " + checkpoint.path().string()};
        }
        checkpoint.saveIfDue(net.parameters(), i + 1, &net.state());
    }
    avatar.textureNet = net.weights();
    paintTexture(device, avatar);
    checkpoint.remove();
}

}  // namespace doppel
