// A body that was recorded: grey, with the vertices that it is said to have.
#pragma once

#include <filesystem>
#include <utility>
#include <vector>

#include "tests/op_test.h"
#include "trainer/motion/synthetic.h"

namespace doppel::test {

// Of so many frames, all round, squares of `size` pixels; poses without noise. rest [V,3]: its rest
// pose.
inline Capture recordedBody(const BodyModel& model, std::vector<float> rest, int frames, int size,
                            const std::filesystem::path& folder) {
    Actor actor;
    actor.body = model;
    actor.body.templateVertices = std::move(rest);
    actor.textureSize = 4;
    actor.texture.assign(48, .5f);
    SyntheticOptions options;
    options.size = size;
    options.poseNoiseDegrees = options.transNoiseMetres = 0;
    return renderActor(testDevice(), actor, actorSession(frames, 0, kActorDistance), folder,
                       options);
}

}  // namespace doppel::test
