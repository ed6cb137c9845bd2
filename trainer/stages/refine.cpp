// Stage 3: the texture refinement network G_RN against an image and a face discriminator, mesh and
// coarse texture network frozen (see nn/steps/refine_step.h).
#include "nn/steps/refine_step.h"

#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/stages/live_state.h"
#include "trainer/stages/stage.h"
#include "trainer/stages/stage_loop.h"
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

void trainRefine(Device& device, TrainResult& result, const TrainSettings& settings) {
    Avatar& avatar = result.avatar;
    const Capture& capture = result.capture;
    // A profile keeps nothing that this stage could stand on: a fresh network does as well.
    if (settings.profileSteps > 0 && avatar.textureNet.empty()) {
        avatar.textureNet = TextureNet(device, avatar, settings.seed).weights();
        paintTexture(device, avatar);
    }
    if (avatar.textureNet.empty())
        throwInput(
            "stage refine: expected an avatar with a texture network; train stage texture "
            "first");
    const RefinePreset& preset = avatar.preset.refine;
    Ranks* sharing = settings.sharing(preset.batch);
    FrameCache cache(capture);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size,
                          {.colours = true,
                           .memoryBudget = settings.memoryBudget,
                           .rim = avatar.preset.texels.rim,
                           .ranks = settings.ranks});

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
    TextureNet coarseNet(device, avatar);
    CoarseTexture coarse{.light = avatar.light};
    if (avatar.preset.texture.constantInput)
        coarse.texture = paintedTexture(device, coarseNet);
    else
        coarse.net = &coarseNet.unet();

    RefineNetworks nets(preset, avatar.preset.texture, static_cast<uint32_t>(settings.seed));
    nets.allocate(device);
    RefineStep step(device, avatar.body, preset, nets, coarse, settings.compileOptions(sharing));

    std::vector<double> weights;
    if (preset.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 41, weights);
    StageLoop loop{.stage = "refine", .steps = stepsOf(preset, capture.size())};
    loop.follow(step.graph, step.losses);
    loop.sharing = sharing;
    loop.identity = stageIdentity(avatar, "refine");
    loop.trained = {{"net", &nets.generator.parameters()},
                    {"image_discriminator", &nets.image.parameters()},
                    {"face_discriminator", &nets.face.parameters()}};
    loop.statistics = {{"statistics", &nets.generator.statistics()}};
    loop.frameName = [&](size_t frame) { return capture.frames[frame].name; };
    loop.draw = [&] { return sampler.next(preset.batch); };
    loop.submit = [&](int64_t i, const std::vector<size_t>& drawn) {
        const std::span<const size_t> mine = partOf(sharing, drawn);
        std::vector<float> centres;
        for (size_t k = 0; k < mine.size(); ++k) {
            const RefineStep::Sample& sample = step.samples[k];
            size_t frame = mine[k];
            step.graph.write(sample.verts, verts[frame]);
            step.graph.write(sample.image, frames.image(frame));
            step.graph.write(sample.mask, frames.mask(frame));
            step.graph.write(sample.camera, cameraValues(rasterCamera(frames.camera(frame))));
            centres.insert(centres.end(), faces[frame].begin(), faces[frame].end());
        }
        step.graph.write(step.faceCentres, centres);
        step.graph.setStep(stepParams(preset, i, loop.steps, settings.seed));
        step.graph.submit();
        frames.prepare(partOf(sharing, sampler.peek(preset.batch)));  // meanwhile
    };
    loop.picture = [&] {
        avatar.refineNet = weightsOf(nets.generator);
        writeState(device, avatar, capture, cache, settings.out);
    };
    if (!loop.run(settings)) return;
    avatar.refineNet = weightsOf(nets.generator);
    bakeTexture(device, avatar, viewsToBake(verts));
}

void planRefine(Device& device, const Avatar& avatar, const Capture&,
                const TrainSettings& settings) {
    const Preset& preset = avatar.preset;
    const auto size = static_cast<size_t>(preset.texture.textureSize);
    const TextureNet coarseNet(device, avatar, settings.seed);
    CoarseTexture coarse{.light = plannedLight(avatar, settings)};
    if (preset.texture.constantInput)
        coarse.texture.resize(size * size * 3);
    else
        coarse.net = &coarseNet.unet();
    RefineNetworks nets(preset.refine, preset.texture, static_cast<uint32_t>(settings.seed));
    nets.allocate(device);
    RefineStep(device, avatar.body, preset.refine, nets, coarse,
               settings.compileOptions(settings.sharing(avatar.preset.refine.batch)));
}

}  // namespace doppel
