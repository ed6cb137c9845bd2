// A training that takes seconds: few steps of small networks on six small frames.
#pragma once

#include <filesystem>

#include "tests/op_test.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/preset.h"
#include "trainer/data/frame_cache.h"
#include "trainer/eval/metrics.h"
#include "trainer/motion/synthetic.h"

namespace doppel::test {

inline Preset tinyPreset() {
    Preset preset = presetByName("ci");
    preset.fit.size = 128;
    preset.fit.passes = 12;
    preset.shape.size = preset.texels.size = 128;
    preset.shape.steps = 20;
    preset.texels.steps = 20;
    preset.texels.samples = 2;
    preset.mesh.size = 128;
    preset.mesh.blocks = 1;
    preset.mesh.layers = 2;
    preset.mesh.hidden = 16;
    preset.mesh.steps = 25;
    preset.texture.size = 64;
    preset.texture.textureSize = 64;
    preset.texture.block = 2;
    preset.texture.depth = 5;
    preset.texture.width = 4;
    preset.texture.steps = 80;
    preset.refine.size = 64;
    preset.refine.depth = 5;
    preset.refine.width = 4;
    preset.refine.discriminatorWidth = 2;
    preset.refine.faceSize = 16;
    return preset;
}

inline Capture tinyCapture(const std::filesystem::path& folder) {
    Actor actor = readActor(assetFolder() / "actor", "woman");
    SyntheticOptions options;
    options.size = 128;
    options.samples = 2;
    return renderActor(testDevice(), actor, actorSession(6, 0, kActorDistance), folder, options);
}

// Of its silhouettes in the capture's poses with the masks, with or without the mesh network.
inline double meanIou(Device& device, const Avatar& avatar, const Capture& capture, bool refined) {
    FrameCache frames(capture);
    AvatarRenderer renderer(device, avatar, refined);
    double sum = 0;
    for (size_t i = 0; i < capture.size(); ++i)
        sum += intersectionOverUnion(
            renderer.mask(capture.theta[i], capture.trans[i], capture.frames[i].camera),
            frames.loadMask(i)->mask);
    return sum / static_cast<double>(capture.size());
}

}  // namespace doppel::test
