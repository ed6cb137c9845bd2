// Motions of other programs: MakeHuman's skeleton, AMASS's npz, and which axis is up.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/files/npz.h"
#include "tests/files.h"
#include "tests/moving_person.h"
#include "trainer/motion/session.h"
#include "trainer/motion/skeleton_motion.h"
#include "trainer/motion/upright.h"

namespace doppel {
namespace {

using namespace test;

// MakeHuman's default rig: a root with a pelvis for each side, limbs of two bones each, five spine
// joints, three of the neck.
TEST(Motions, MakeHuman) {
    const auto bones = person();
    const auto frames = poses(bones.size());
    const auto where = places(frames.size());
    std::vector<Bone> rig = {{"root", -1, {0, .95, 0}}};
    std::vector<Turns> turned(frames.size());
    for (size_t f = 0; f < frames.size(); ++f) turned[f].push_back(frames[f][0]);
    const auto add = [&](const std::string& name, int parent, glm::dvec3 offset, int source) {
        rig.push_back({name, parent, offset});
        for (size_t f = 0; f < frames.size(); ++f)
            turned[f].push_back(source < 0 ? glm::dquat(1, 0, 0, 0)
                                           : frames[f][static_cast<size_t>(source)]);
        return static_cast<int>(rig.size()) - 1;
    };
    const int low = add("spine04", 0, bones[1].offset, 1);
    const int middle = add("spine03", low, bones[2].offset, 2);
    const int high = add("spine01", middle, bones[3].offset, 3);
    const int neck = add("neck01", high, bones[4].offset, 4);
    add("head", neck, bones[5].offset, 5);
    for (const int s : {0, 1}) {
        const std::string side = s ? ".R" : ".L";
        const int from = 6 + 8 * s;
        const auto offset = [&](int k) { return bones[static_cast<size_t>(from + k)].offset; };
        const int pelvis = add("pelvis" + side, 0, offset(0) * .4, -1);
        const int thigh = add("upperleg01" + side, pelvis, offset(0) * .6, from);
        const int twist = add("upperleg02" + side, thigh, offset(1) * .5, -1);
        const int shin = add("lowerleg01" + side, twist, offset(1) * .5, from + 1);
        const int foot = add("foot" + side, shin, offset(2), from + 2);
        add("toe1-1" + side, foot, offset(3), from + 3);
        const int clavicle = add("clavicle" + side, high, offset(4), from + 4);
        const int shoulder = add("shoulder01" + side, clavicle, offset(5) * .5, -1);
        const int arm = add("upperarm01" + side, shoulder, offset(5) * .5, from + 5);
        const int fore = add("lowerarm01" + side, arm, offset(6), from + 6);
        add("wrist" + side, fore, offset(7), from + 7);
    }
    expectSame(expectedOf(rig, turned, where), expectedOf(bones, frames, where), 2e-3);
}

struct AmassFile {
    std::vector<double> poses, trans;
    size_t frames = 0;
    void add(const Theta& theta, const glm::dvec3& moved, size_t width) {
        for (size_t k = 0; k < width; ++k)
            poses.push_back(k < 66 ? static_cast<double>(theta[k]) : .1);
        for (int c = 0; c < 3; ++c) trans.push_back(moved[c]);
        ++frames;
    }
};

// Walks in a world with z up, as AMASS has it.
TEST(Motions, AmassOfEitherBody) {
    Folder folder;
    const glm::dquat zUp = turn(90, kX) * glm::dquat(0, 1, 0, 0);  // from the camera's y down
    for (const bool expressive : {false, true}) {
        AmassFile file;
        std::vector<Theta> truth;
        const size_t width = expressive ? 165 : 156;
        const auto session = actorSession(2, 6, 3);
        for (size_t f = 0; f < session.size(); ++f) {
            Theta theta = session[f].theta;
            setJointRotation(theta, 0, zUp * jointRotation(theta, 0));
            file.add(theta, {.1 * double(f), 0, .9}, width);
            truth.push_back(theta);
        }
        Npz npz;
        const auto count = static_cast<int64_t>(file.frames);
        npz.set("poses", Array::f64({count, static_cast<int64_t>(width)}, file.poses));
        npz.set("trans", Array::f64({count, 3}, file.trans));
        npz.set("betas", Array::f64({16}, std::vector<double>(16)));
        npz.set("gender", Array::text("female"));
        if (expressive) {
            npz.set("mocap_frame_rate", Array::scalarF64(120));
            npz.set("surface_model_type", Array::text("smplx"));
        } else {
            npz.set("mocap_framerate", Array::scalarF64(60));
            npz.set("dmpls", Array::f64({count, 8}, std::vector<double>(8 * file.frames)));
        }
        writeNpz(folder / "walk_poses.npz", npz, true);
        const Motion motion = readMotion(folder / "walk_poses.npz");
        ASSERT_EQ(motion.size(), file.frames);
        EXPECT_EQ(motion.fps, expressive ? 120 : 60);
        EXPECT_EQ(takenAs(motion), fmt::format("AMASS, {} a second, z up", expressive ? 120 : 60));
        for (size_t f = 0; f < motion.size(); ++f) {
            for (size_t k = 0; k < 66; ++k) EXPECT_NEAR(motion.theta[f][k], truth[f][k], 1e-5);
            // SMPL+H's hands and SMPL-X's jaw are no joints of ours.
            for (size_t k = 66; k < 72; ++k) EXPECT_EQ(motion.theta[f][k], 0);
            EXPECT_NEAR(motion.trans[f][0], .1 * double(f) + (expressive ? .0031 : 0), 1e-5);
            EXPECT_NEAR(motion.trans[f][2], .9 + (expressive ? .012 - .028 : 0), 1e-5);
        }
        EXPECT_LT(glm::length(uprightRotation(motion) * kZ - kY), 1e-9);
    }
}

// Somebody who rolls about on the floor of a world with z up: the bodies' own axes say nothing.
TEST(Motions, TheGroundSaysWhichAxisIsUp) {
    Motion rolling;
    for (int f = 0; f < 24; ++f) {
        Theta theta{};
        // Along x on the ground, turning about the own length.
        setJointRotation(theta, 0, turn(-90, kZ) * turn(15. * f, kY));
        rolling.theta.push_back(theta);
        rolling.trans.push_back({0, .2f * static_cast<float>(f), 0});
        double low = 0;
        for (const glm::dvec3& place : placeJoints(theta, {})) low = std::min(low, place.z);
        rolling.trans.back()[2] = static_cast<float>(-low);
    }
    EXPECT_LT(glm::length(uprightRotation(rolling) * kZ - kY), 1e-9);
    EXPECT_EQ(takenAs(rolling), "z up");
    // The same in a world with y up.
    Motion other = rolling;
    for (size_t f = 0; f < other.size(); ++f)
        movePose({glm::mat3_cast(turn(-90, kX)), glm::dvec3(0)}, other.theta[f], other.trans[f]);
    EXPECT_EQ(takenAs(other), "y up");
}

// ---- between poses ------------------------------------------------------------------------------

TEST(Poses, TheSmallestTurnBetweenTwoDirections) {
    const std::vector<glm::dvec3> directions = {
        kX, kY, kZ, -kX, -kY, -kZ, glm::normalize(glm::dvec3(1, -2, .5))};
    for (const glm::dvec3& from : directions)
        for (const glm::dvec3& to : directions) {
            const glm::dquat turned = turnBetween(from, to);
            EXPECT_LT(glm::length(turned * from - to), 1e-9);
            EXPECT_NEAR(glm::length(axisAngleOf(turned)),
                        std::acos(std::clamp(glm::dot(from, to), -1., 1.)), 1e-7);
        }
}

TEST(Poses, BetweenTwo) {
    Theta one{}, other{};
    setJointRotation(one, joint::kHead, turn(-170, kY));
    setJointRotation(other, joint::kHead, turn(170, kY));
    // Over the back, and not by the front.
    const Theta middle = thetaBetween(one, other, .25);
    EXPECT_LT(glm::length(axisAngleOf(jointRotation(middle, joint::kHead) *
                                      glm::conjugate(turn(-175, kY)))),
              1e-5);
    EXPECT_EQ(middle[3 * joint::kNeck], 0);
    EXPECT_EQ(transBetween({0, 2, -4}, {4, 2, 4}, .25), (Trans{1, 2, -2}));
}

}  // namespace
}  // namespace doppel
