// Stage 3: the texture refinement network G_RN against an image and a face discriminator, mesh and
// coarse texture network frozen (see nn/steps/refine_step.h).
#include "nn/steps/refine_step.h"

#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/stages/live_state.h"
#include "trainer/stages/stage_loop.h"
#include "trainer/stages/train.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

namespace {

constexpr size_t kBakedViews = 48;  // at most

// Evenly spaced frames of the capture.
std::vector<std::vector<float>> viewsToBake(const std::vector<std::vector<float>>& verts) {
    std::vector<std::vector<float>> views;
    size_t count = std::min(kBakedViews, verts.size());
    for (size_t k = 0; k < count; ++k) views.push_back(verts[k * verts.size() / count]);
    return views;
}

}  // namespace

void trainRefine(Device& device, Avatar& avatar, const Capture& capture,
                 const TrainSettings& settings) {
    if (avatar.textureNet.empty())
        throwInput(
            "stage refine: expected an avatar with a texture network; train stage texture "
            "first");
    const RefinePreset& preset = avatar.preset.refine;
    FrameCache cache(capture);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size, true, 1,
                          settings.memoryBudget);

    // The mesh network is frozen: each frame's mesh is made once. The face is where the head is.
    std::vector<std::vector<float>> verts;
    std::vector<std::array<float, 2>> faces;
    {
        Avatar plain = avatar;
        plain.clearRefinement();
        AvatarRenderer renderer(device, plain);
        BodyPoser poser(device, avatar.body);
        for (size_t i = 0; i < capture.size(); ++i) {
            verts.push_back(renderer.vertices(capture.theta[i], capture.trans[i]));
            PosedMesh posed = poser.pose(capture.theta[i], capture.trans[i], capture.betas);
            auto [u, v] = frames.camera(i).project(posed.joints.at(joint::kHead));
            faces.push_back({static_cast<float>(u), static_cast<float>(v)});
        }
    }

    // The coarse network is in evaluation; with a constant input it paints one texture for all.
    TextureNet coarseNet(device, avatar.preset.texture, avatar.textureNet);
    CoarseTexture coarse;
    if (avatar.preset.texture.constantInput)
        coarse.texture = paintedTexture(device, coarseNet);
    else
        coarse.net = &coarseNet.unet();

    RefineConfig config = refineConfig(avatar.preset);
    RefineNetworks nets(config, static_cast<uint32_t>(settings.seed));
    nets.allocate(device);
    RefineStep step(
        device, avatar.body, config, nets, coarse,
        {.memoryBudget = settings.memoryBudget, .timestamps = settings.profileSteps > 0});
    if (settings.profileSteps > 0) printPlan("refine", step.graph, nets.generator.parameters());

    int64_t perEpoch = (static_cast<int64_t>(capture.size()) + preset.batch - 1) / preset.batch;
    int64_t steps = preset.steps > 0 ? preset.steps : preset.epochs * perEpoch;
    std::vector<double> weights;
    if (preset.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 41, weights);
    std::vector<size_t> drawn(step.samples.size());

    StageLoop loop{.stage = "refine", .steps = steps};
    std::vector<Tensor> losses{step.generatorLoss, step.reconstruction, step.misaligned};
    loop.columns = {"loss", "reconstruction", "misaligned"};
    auto addLoss = [&](const char* name, const Tensor& loss) {
        if (!loss) return;
        loop.columns.push_back(name);
        losses.push_back(loss);
    };
    addLoss("gan_image", step.ganImage);
    addLoss("gan_face", step.ganFace);
    addLoss("discriminator_image", step.discriminatorImage);
    addLoss("discriminator_face", step.discriminatorFace);

    loop.identity = stageIdentity(avatar, "refine");
    loop.trained = {{"net", &nets.generator.parameters()},
                    {"image_discriminator", &nets.image.parameters()},
                    {"face_discriminator", &nets.face.parameters()}};
    loop.statistics = {{"statistics", &nets.generator.statistics()}};
    loop.draw = [&] {
        for (size_t& frame : drawn) frame = sampler.next();
    };
    loop.submit = [&](int64_t i) {
        std::vector<float> centres;
        for (size_t k = 0; k < drawn.size(); ++k) {
            const RefineStep::Sample& sample = step.samples[k];
            size_t frame = drawn[k];
            step.graph.write(sample.verts, verts[frame]);
            step.graph.write(sample.image, frames.image(frame));
            step.graph.write(sample.mask, frames.mask(frame));
            step.graph.write(sample.camera, cameraValues(rasterCamera(frames.camera(frame))));
            centres.insert(centres.end(), faces[frame].begin(), faces[frame].end());
        }
        step.graph.write(step.faceCentres, centres);
        step.graph.setStep(stepParams(i, settings.seed,
                                      scheduledRate(preset.lr, preset.constantPart, i, steps),
                                      config.generatorOptimiser));
        step.graph.submit();
        frames.prepare(sampler.peek(drawn.size()));  // meanwhile
    };
    loop.report = [&](int64_t i, int back) {
        StageLoop::Report report;
        for (const Tensor& loss : losses)
            report.logged.push_back(readLoss(step.graph, loss, "refine", i, back));
        for (size_t c = 1; c < losses.size(); ++c)
            if (c == 1 || loop.columns[c].starts_with("gan_"))
                report.shown.emplace_back(loop.columns[c], report.logged[c]);
        return report;
    };
    loop.picture = [&] {
        avatar.refineNet = weightsOf(nets.generator);
        writeState(device, avatar, capture, cache, settings.out);
    };
    loop.profile = [&] { printProfile("refine", step.graph); };
    if (!loop.run(settings)) return;
    avatar.refineNet = weightsOf(nets.generator);
    bakeTexture(device, avatar, viewsToBake(verts));
}

}  // namespace doppel
