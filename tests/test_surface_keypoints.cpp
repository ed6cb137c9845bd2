// Keypoints in the steps of a body's own surface: limbs before the body, which outlines do not
// show, go where their joints were seen.
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>

#include "tests/files.h"
#include "tests/recorded_body.h"
#include "trainer/avatar/preset.h"
#include "trainer/data/pose.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/stages/surface.h"

namespace doppel::test {
namespace {

constexpr int kSize = 256;

// Somebody seen from the front who holds a hand before the belly, a hand's breadth higher than the
// poses have it.
struct HandBeforeBelly {
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    Folder folder;
    Capture capture;
    JointPlaces truth;  // in each of the frames, which are alike

    HandBeforeBelly() {
        Actor actor{body, std::vector<float>(48, .5f), 4};
        MotionFrame frame = actorSession(1, 0, kActorDistance).front();
        const auto bend = [&](size_t joint, const glm::dvec3& by) {
            setJointRotation(frame.theta, joint, quaternionOf({by.x, by.y, by.z}));
        };
        bend(joint::kRightShoulder, {0, 0, 1.2});
        bend(joint::kRightElbow, {0, 2.1, 0});
        SyntheticOptions options;
        options.size = kSize;
        options.poseNoiseDegrees = options.transNoiseMetres = 0;
        capture = renderActor(testDevice(), actor, {frame, frame}, folder / "capture", options);
        truth = jointPlaces(body, capture.betas, capture.theta[0], capture.trans[0]);

        const std::span<const int> joints = keypointJoints("openpose25");
        Keypoints seen{"openpose25", 25, {}};
        for (const Frame& picture : capture.frames)
            for (int joint : joints) {
                const glm::dvec3 at = joint < 0 ? glm::dvec3(0, 0, 1) : truth[size_t(joint)];
                const auto [u, v] = picture.camera.project({at.x, at.y, at.z});
                for (double value : {u, v, joint < 0 ? 0. : .8})
                    seen.values.push_back(float(value));
            }
        capture.keypoints = seen;
        for (Theta& theta : capture.theta)
            setJointRotation(theta, joint::kRightElbow,
                             quaternionOf({0, 2.1, 0}) * quaternionOf({0, 0, .35}));
    }
    double wristOff(const Capture& poses) const {  // mm, in the first frame
        return 1000 * glm::length(jointPlaces(body, poses.betas, poses.theta[0],
                                              poses.trans[0])[joint::kRightWrist] -
                                  truth[joint::kRightWrist]);
    }
};

TEST(Surface, LimbsBeforeTheBodyGoWhereTheirJointsWereSeen) {
    const HandBeforeBelly person;
    const double before = person.wristOff(person.capture);
    EXPECT_GT(before, 60);
    const auto after = [&](double weight) {
        SurfaceRun run{.stage = "shape", .preset = presetByName("ci").shape, .movesOffsets = true};
        run.preset.size = kSize;
        run.preset.steps = 60;
        run.preset.keypoints = weight;
        Capture capture = person.capture;
        runSurface(testDevice(), person.body, capture, run);
        return person.wristOff(capture);
    };
    const double without = after(0), with = after(.3);
    std::cout << "the wrist is off by " << before << " mm, " << without << " after outlines alone, "
              << with << " with keypoints\n";
    EXPECT_GT(without, .6 * before);
    EXPECT_LT(with, .45 * before);
}

}  // namespace
}  // namespace doppel::test
