// Stage 2: the coarse texture network G_TN, trained against the frames through the hard textured
// rasterizer, the mesh network frozen (see nn/steps/texture_step.h).
#include "nn/steps/texture_step.h"

#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/stages/live_state.h"
#include "trainer/stages/stage.h"
#include "trainer/stages/stage_loop.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

void trainTexture(Device& device, TrainResult& result, const TrainSettings& settings) {
    Avatar& avatar = result.avatar;
    const Capture& capture = result.capture;
    TexturePreset preset = avatar.preset.texture;
    // Texels that frames gave are near their best: what a network does to them in long steps is
    // noise.
    if (!avatar.texels.empty()) preset.lr = preset.lrOver;
    Ranks* sharing = settings.sharing(preset.batch);
    FrameCache cache(capture);
    TrainingFrames frames(device, avatar.body, capture, cache, preset.size,
                          {.colours = true,
                           .memoryBudget = settings.memoryBudget,
                           .rim = avatar.preset.texels.rim,
                           .ranks = settings.ranks});

    // The mesh network is frozen: each frame's mesh is made once.
    std::vector<std::vector<float>> verts;
    {
        AvatarRenderer renderer(device, avatar);
        for (size_t i = 0; i < capture.size(); ++i)
            verts.push_back(renderer.vertices(capture.theta[i], capture.trans[i]));
    }

    TextureNet net(device, avatar, settings.seed);
    TextureStep step(device, avatar.body, net.unet(), preset, settings.compileOptions(sharing),
                     avatar.light);

    std::vector<double> weights;
    if (avatar.preset.mesh.balanceHeadings) weights = headingWeights(capture);
    FrameSampler sampler(frames.count(), settings.seed + 29, weights);
    StageLoop loop{.stage = "texture", .steps = preset.steps};
    loop.follow(step.graph, step.losses);
    loop.sharing = sharing;
    loop.identity = stageIdentity(avatar, "texture");
    loop.trained = {{"net", &net.parameters()}};
    loop.statistics = {{"statistics", &net.state()}};
    loop.frameName = [&](size_t frame) { return capture.frames[frame].name; };
    loop.draw = [&] { return sampler.next(preset.batch); };
    loop.submit = [&](int64_t i, const std::vector<size_t>& drawn) {
        const std::span<const size_t> mine = partOf(sharing, drawn);
        for (size_t k = 0; k < mine.size(); ++k) {
            const TextureStep::Sample& sample = step.samples[k];
            size_t frame = mine[k];
            step.graph.write(sample.verts, verts[frame]);
            step.graph.write(sample.image, frames.image(frame));
            step.graph.write(sample.mask, frames.mask(frame));
            step.graph.write(sample.camera, cameraValues(rasterCamera(frames.camera(frame))));
        }
        step.graph.setStep(stepParams(preset, i, loop.steps, settings.seed));
        step.graph.submit();
        frames.prepare(partOf(sharing, sampler.peek(preset.batch)));  // meanwhile
    };
    auto paint = [&] {
        avatar.textureNet = net.weights();
        paintTexture(device, avatar);
    };
    loop.picture = [&] {
        paint();
        writeState(device, avatar, capture, cache, settings.out);
    };
    if (loop.run(settings)) paint();
}

void planTexture(Device& device, const Avatar& avatar, const Capture&,
                 const TrainSettings& settings) {
    const TextureNet net(device, avatar, settings.seed);
    TextureStep(device, avatar.body, net.unet(), avatar.preset.texture,
                settings.compileOptions(settings.sharing(avatar.preset.texture.batch)),
                plannedLight(avatar, settings));
}

}  // namespace doppel
