// Exports as Debian's Blender shows them, beside what `doppel render` draws.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "engine/io/image.h"
#include "tests/files.h"
#include "tests/moving_person.h"
#include "tests/op_test.h"
#include "tests/striped_avatar.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/export.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

constexpr int kSize = 384;
constexpr double kFocal = 450;

bool hasBlender() { return std::system("command -v blender > /dev/null") == 0; }

// Somebody who stands before the camera, an arm lowered, and turns.
Motion turning() {
    Motion motion;
    motion.fps = 30;
    for (uint32_t f = 0; f < 12; ++f) {
        Theta theta{};
        std::ranges::copy(uprightOrientation(.3f + .1f * float(f)), theta.begin());
        theta[3 * joint::kLeftShoulder + 2] = -.7f;
        motion.theta.push_back(theta);
        motion.trans.push_back({.1f + .01f * float(f), .1f, 3.3f});
    }
    return motion;
}

class InBlender : public ::testing::Test {
protected:
    void SetUp() override {
        if (!hasBlender()) GTEST_SKIP() << "exports are looked at with blender, not installed here";
        exportAvatar(testDevice(), avatar_, folder_ / "me.glb", &motion_);
    }

    void run(const char* script, const std::string& words) {
        const std::string command = fmt::format(
            "blender --background --factory-startup --python-exit-code 1 --python "
            "'{}/tests/blender/{}' -- {} > '{}' 2>&1",
            test::sourceFolder().string(), script, words, (folder_ / "log").string());
        EXPECT_EQ(std::system(command.c_str()), 0) << test::bytesOf(folder_ / "log");
    }

    // Blender's picture through the camera of the poses, frame by frame from zero; bones are turned
    // about axes of camera space (x right, y down).
    Image picture(size_t frame, const std::map<size_t, glm::dvec3>& turns) {
        return picture("me.glb", 0, frame, turns);
    }
    // first: the motion's frame with which the file begins.
    Image picture(const char* file, size_t first, size_t frame,
                  const std::map<size_t, glm::dvec3>& turns) {
        // An export's world is camera space turned by half a turn about x, the lowest vertex of the
        // first frame on the ground and its pelvis above the origin.
        const std::vector<float> verts = AvatarRenderer(testDevice(), avatar_)
                                             .vertices(motion_.theta[first], motion_.trans[first]);
        double ground = -INFINITY;
        for (size_t i = 1; i < verts.size(); i += 3) ground = std::max(ground, double{verts[i]});
        const std::vector<double> rest = restJoints(avatar_.body, std::vector<double>(10));
        nlohmann::json pose = nlohmann::json::object();
        for (const auto& [joint, turn] : turns) pose[jointName(joint)] = {turn.x, -turn.y, -turn.z};
        const Trans& t = motion_.trans[first];
        const nlohmann::json asked{
            {"model", (folder_ / file).string()},
            {"out", (folder_ / "picture.png").string()},
            {"size", kSize},
            {"fov", 2 * std::atan(kSize / 2. / kFocal) * 180 / std::acos(-1.)},
            {"camera", {-(rest[0] + double{t[0]}), ground, rest[2] + double{t[2]}}},
            {"fps", 30},
            {"frame", frame},
            {"pose", pose}};
        folder_.write("scene.json", asked.dump());
        run("picture.py", fmt::format("'{}'", (folder_ / "scene.json").string()));
        return readImage(folder_ / "picture.png", 4);
    }

    void expectTheSame(const Image& shown, const Theta& theta, const Trans& trans) {
        test::expectShows(shown, avatar_, theta, trans, kFocal);
    }

    test::Folder folder_;
    Avatar avatar_ = test::stripedAvatar();
    Motion motion_ = turning();
};

TEST_F(InBlender, AnAnimationIsWhatRenderDraws) {
    for (size_t frame : {size_t{0}, size_t{7}})
        expectTheSame(picture(frame, {}), motion_.theta[frame], motion_.trans[frame]);
}

TEST_F(InBlender, JointsArePosed) {
    constexpr size_t kFrame = 4;
    const std::map<size_t, glm::dvec3> turns{{joint::kRightShoulder, {0, 0, -1.1}},
                                             {joint::kLeftKnee, {.9, .2, 0}}};
    Theta theta = motion_.theta[kFrame];
    for (const auto& [joint, turn] : turns) {
        // A turn of what hangs on the joint, about axes of the camera.
        glm::dquat parents(1, 0, 0, 0);
        for (int32_t j = avatar_.body.parents[joint]; j >= 0; j = avatar_.body.parents[size_t(j)])
            parents = jointRotation(theta, size_t(j)) * parents;
        const glm::dquat turned = glm::angleAxis(glm::length(turn), glm::normalize(turn));
        setJointRotation(theta, joint,
                         glm::inverse(parents) * turned * parents * jointRotation(theta, joint));
    }
    expectTheSame(picture(kFrame, turns), theta, motion_.trans[kFrame]);
}

// One pose, as the networks make it; the material and its picture are found beside the mesh.
TEST_F(InBlender, AnObjIsWhatRenderDraws) {
    constexpr size_t kFrame = 7;
    const std::vector<size_t> one{kFrame};
    const Motion motion = motion_.subset(one);
    exportAvatar(testDevice(), avatar_, folder_ / "pose.obj", &motion);
    expectTheSame(picture("pose.obj", kFrame, 0, {}), motion_.theta[kFrame], motion_.trans[kFrame]);
}

// Binary files, whose bones have axes of Blender's.
TEST_F(InBlender, WritesFbxThatIsTheSameMotion) {
    run("to_fbx.py",
        fmt::format("'{}' '{}' 30", (folder_ / "me.glb").string(), (folder_ / "me.fbx").string()));
    test::expectSame(readMotion(folder_ / "me.fbx"), readMotion(folder_ / "me.glb"), 1e-3);
}

}  // namespace
}  // namespace doppel
