// Skeletons of BVH on SMPL's joints: rest poses, names, spines, axes, units.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>

#include "engine/error.h"
#include "nn/body/body.h"
#include "nn/body/joint.h"
#include "tests/bvh_text.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/rendering.h"
#include "trainer/motion/bvh.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

using namespace test;

TEST(Bvh, ReadsTPoses) {
    const std::vector<Angles> frames = {
        {},
        {{"LeftForeArm", turn(-90, kY)}, {"RightForeArm", turn(90, kY)}},
        {{"Hips", turn(50, kY)}, {"LeftLeg", turn(70, kX)}, {"Head", turn(20, kX)}},
        {{"LeftArm", turn(-80, kZ)}, {"LeftHand", turn(15, kZ)}, {"LeftFoot", turn(-10, kX)}},
    };
    const std::vector<glm::dvec3> places(frames.size(), glm::dvec3(0, .95, 0));
    const Motion motion = motionOf(bvhText(person(false), frames, places));
    ASSERT_EQ(motion.size(), 4u);
    EXPECT_EQ(motion.fps, 30);
    EXPECT_EQ(motion.name, "test");
    // The T-pose but for the legs: SMPL's stand a little apart, this person's are parallel.
    for (size_t j = 0; j < joint::kCount; ++j) {
        const bool leg = j == joint::kLeftHip || j == joint::kRightHip || j == joint::kLeftKnee ||
                         j == joint::kRightKnee || j == joint::kLeftAnkle ||
                         j == joint::kRightAnkle;
        EXPECT_LT(glm::length(axisAngle(motion.theta[0], j)), leg ? .13 : 1e-3) << jointName(j);
    }
    expectRotation(motion.theta[1], joint::kLeftElbow, -90 * kDegree * kY, 1e-3);
    expectRotation(motion.theta[1], joint::kRightElbow, 90 * kDegree * kY, 1e-3);
    expectRotation(motion.theta[1], joint::kLeftShoulder, glm::dvec3(0), 1e-3);
    expectRotation(motion.theta[2], joint::kPelvis, 50 * kDegree * kY);
    EXPECT_NEAR(glm::length(axisAngle(motion.theta[2], joint::kLeftKnee)), 70 * kDegree, .15);
    expectRotation(motion.theta[2], joint::kHead, 20 * kDegree * kX);
    expectRotation(motion.theta[3], joint::kLeftShoulder, -80 * kDegree * kZ, 1e-3);
    expectRotation(motion.theta[3], joint::kLeftWrist, 15 * kDegree * kZ, 1e-3);
    // Feet stay level over straight legs; what turns them is the motion.
    EXPECT_NEAR(glm::length(axisAngle(motion.theta[3], joint::kLeftAnkle) -
                            axisAngle(motion.theta[0], joint::kLeftAnkle)),
                10 * kDegree, .02);
}

TEST(Bvh, TakesOutArmsThatHangInTheRestPose) {
    const std::vector<Angles> frames = {
        {},
        {{"LeftArm", turn(90, kZ)}, {"RightArm", turn(-90, kZ)}},
        {{"LeftForeArm", turn(-60, kX)}, {"RightForeArm", turn(-60, kX)}},
    };
    const std::vector<glm::dvec3> places(frames.size(), glm::dvec3(0, .95, 0));
    const Motion motion = motionOf(bvhText(person(true), frames, places));
    expectRotation(motion.theta[0], joint::kLeftShoulder, -90 * kDegree * kZ, 1e-3);
    expectRotation(motion.theta[0], joint::kRightShoulder, 90 * kDegree * kZ, 1e-3);
    for (size_t j : {joint::kLeftElbow, joint::kRightElbow, joint::kLeftWrist, joint::kSpine2})
        expectRotation(motion.theta[0], j, glm::dvec3(0), 1e-3);
    // Lifted, they are a T.
    expectRotation(motion.theta[1], joint::kLeftShoulder, glm::dvec3(0), 1e-3);
    expectRotation(motion.theta[1], joint::kRightShoulder, glm::dvec3(0), 1e-3);
    // Forearms lifted forward fold as elbows do: the left about −y.
    expectRotation(motion.theta[2], joint::kLeftElbow, -60 * kDegree * kY, 1e-3);
    expectRotation(motion.theta[2], joint::kRightElbow, 60 * kDegree * kY, 1e-3);
}

TEST(Bvh, KnowsTheNamesInUse) {
    const std::vector<std::map<std::string, std::string>> dialects = {
        // Mixamo
        {{"", "mixamorig:*"}},
        // Biovision
        {{"Spine", "Chest"},
         {"Spine1", "Chest2"},
         {"Spine2", "Chest3"},
         {"Shoulder", "Collar"},
         {"Arm", "Shoulder"},
         {"ForeArm", "Elbow"},
         {"Hand", "Wrist"},
         {"UpLeg", "Hip"},
         {"Leg", "Knee"},
         {"Foot", "Ankle"},
         {"ToeBase", "Toe"}},
        // Poser
        {{"Hips", "hip"},
         {"Spine", "abdomen"},
         {"Spine1", "waist"},
         {"Spine2", "chest"},
         {"Neck", "neck"},
         {"Head", "head"},
         {"Left", "l"},
         {"Right", "r"},
         {"Shoulder", "Collar"},
         {"Arm", "Shldr"},
         {"UpLeg", "Thigh"},
         {"Leg", "Shin"},
         {"ToeBase", "Toe"}},
        // Unreal
        {{"Hips", "pelvis"},
         {"Spine", "spine_01"},
         {"Spine1", "spine_02"},
         {"Spine2", "spine_03"},
         {"Neck", "neck_01"},
         {"Head", "head"},
         {"Left", "_l"},
         {"Right", "_r"},
         {"Shoulder", "clavicle"},
         {"Arm", "upperarm"},
         {"ForeArm", "lowerarm"},
         {"Hand", "hand"},
         {"UpLeg", "thigh"},
         {"Leg", "calf"},
         {"Foot", "foot"},
         {"ToeBase", "ball"}},
        // 3ds Max
        {{"Hips", "Bip01 Pelvis"},
         {"Left", "Bip01 L "},
         {"Right", "Bip01 R "},
         {"Spine", "Bip01 Spine"},
         {"Neck", "Bip01 Neck"},
         {"Head", "Bip01 Head"},
         {"Shoulder", "Clavicle"},
         {"Arm", "UpperArm"},
         {"ForeArm", "Forearm"},
         {"UpLeg", "Thigh"},
         {"Leg", "Calf"},
         {"ToeBase", "Toe0"}},
        // Xsens, Rokoko
        {{"Spine", "L5"},
         {"Spine1", "L3"},
         {"Spine2", "T8"},
         {"Arm", "UpperArm"},
         {"UpLeg", "UpperLeg"},
         {"Leg", "LowerLeg"},
         {"ToeBase", "Toe"}},
        {{"UpLeg", "Thigh"}, {"Leg", "Shin"}, {"ToeBase", "Toe"}},
        // SOMA
        {{"Spine", "Spine1"},
         {"Spine1", "Spine2"},
         {"Spine2", "Chest"},
         {"Neck", "Neck1"},
         {"UpLeg", "Leg"},
         {"Leg", "Shin"}},
        // SMPL's programs
        {{"Hips", "Pelvis"},
         {"Left", "L_"},
         {"Right", "R_"},
         {"UpLeg", "Hip"},
         {"Leg", "Knee"},
         {"Foot", "Ankle"},
         {"ToeBase", "Foot"},
         {"Shoulder", "Collar"},
         {"Arm", "Shoulder"},
         {"ForeArm", "Elbow"},
         {"Hand", "Wrist"}},
        // All in capitals
        {{"Left", "LEFT"},
         {"Right", "RIGHT"},
         {"UpLeg", "UPLEG"},
         {"Leg", "LEG"},
         {"Arm", "ARM"},
         {"ForeArm", "FOREARM"},
         {"Foot", "FOOT"},
         {"Hand", "HAND"},
         {"ToeBase", "TOEBASE"},
         {"Shoulder", "SHOULDER"}},
    };
    const std::vector<Bone> bones = person(true);
    Angles angles = {{"Hips", turn(30, kY)}, {"Spine1", turn(10, kX)}, {"Neck", turn(12, kZ)}};
    for (const char* side : {"Left", "Right"})
        for (const char* part :
             {"UpLeg", "Leg", "Foot", "ToeBase", "Shoulder", "Arm", "ForeArm", "Hand"})
            angles[side + std::string(part)] =
                turn(7 + double(angles.size()) * 2, glm::normalize(glm::dvec3(1, .4, -.3)));
    const auto renamed = [&](std::string name, const std::map<std::string, std::string>& by) {
        if (by.contains("")) return "mixamorig:" + name;
        if (name.empty()) return name;
        std::string side;
        for (const char* s : {"Left", "Right"})
            if (name.starts_with(s)) side = s, name.erase(0, side.size());
        if (by.contains(name)) name = by.at(name);
        if (side.empty()) return name;
        const std::string as = by.contains(side) ? by.at(side) : side;
        return as.starts_with("_") ? name + as : as + name;
    };
    const std::vector<glm::dvec3> place = {{.1, .9, .2}};
    const Motion expected = motionOf(bvhText(bones, {angles}, place));
    for (const auto& dialect : dialects) {
        std::vector<Bone> named;
        Angles turned;
        for (const Bone& bone : bones) {
            named.push_back({renamed(bone.name, dialect),
                             bone.parent.empty() ? "" : renamed(bone.parent, dialect),
                             bone.offset});
            if (angles.contains(bone.name)) turned[named.back().name] = angles[bone.name];
        }
        const Motion found = motionOf(bvhText(named, {turned}, place));
        for (size_t i = 0; i < 72; ++i)
            EXPECT_NEAR(found.theta[0][i], expected.theta[0][i], 1e-6)
                << named[1].name << ": " << jointName(i / 3);
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(found.trans[0][c], expected.trans[0][c], 1e-6) << named[1].name;
    }
}

// A shin without a thigh is not both.
TEST(Bvh, NeedsAThigh) {
    std::vector<Bone> bones;
    for (const Bone& bone : person(true)) {
        const auto as = [](std::string name) {
            if (const size_t at = name.find("UpLeg"); at != std::string::npos)
                return name.replace(at, 5, "Piece");
            if (const size_t at = name.find("Leg"); at != std::string::npos)
                return name.replace(at, 3, "Shin");
            return name;
        };
        bones.push_back({as(bone.name), as(bone.parent), bone.offset});
    }
    const std::string message = messageOf<InputError>([&] {
        motionOf(bvhText(bones, {{}}, {{0, .9, 0}}));
    });
    EXPECT_NE(message.find("found none for left_hip, right_hip among"), std::string::npos)
        << message;
}

// CMU's files as they are: hips above a hip joint of no length, two necks, a back of three.
TEST(Bvh, ReadsCmusSkeleton) {
    std::vector<Bone> bones;
    for (Bone bone : person(false)) {
        if (bone.name == "Spine") bone.name = "LowerBack";
        if (bone.parent == "Spine") bone.parent = "LowerBack";
        if (bone.name == "Spine1") bone.name = "Spine";
        if (bone.parent == "Spine1") bone.parent = "Spine";
        if (bone.name == "Spine2") bone.name = "Spine1";
        if (bone.parent == "Spine2") bone.parent = "Spine1";
        if (bone.name == "Neck")
            bones.push_back({"Neck", "Spine1", bone.offset / 2.}),
                bone = {"Neck1", "Neck", bone.offset / 2.};
        if (bone.name == "Head") bone.parent = "Neck1";
        for (const char* side : {"Left", "Right"}) {
            if (bone.name != side + std::string("UpLeg")) continue;
            const std::string joint = std::string(1, side[0]) + "HipJoint";
            bones.push_back({joint, "Hips", {0, 0, 0}});
            bone.parent = joint;
        }
        bones.push_back(bone);
    }
    const Angles angles = {{"LHipJoint", turn(20, kX)}, {"LeftUpLeg", turn(-50, kX)},
                           {"Neck", turn(10, kY)},      {"Neck1", turn(20, kY)},
                           {"LowerBack", turn(5, kX)},  {"Spine", turn(8, kX)},
                           {"Spine1", turn(11, kX)}};
    const Motion motion = motionOf(bvhText(bones, {angles, {}}, {{0, .95, 0}, {0, .95, 0}}));
    expectRotation(motion.theta[0], joint::kSpine1, 5 * kDegree * kX);
    expectRotation(motion.theta[0], joint::kSpine2, 8 * kDegree * kX);
    expectRotation(motion.theta[0], joint::kSpine3, 11 * kDegree * kX);
    // Of both necks together 30 degrees; the middle of them for the neck, the rest for the head.
    expectRotation(motion.theta[0], joint::kNeck, 20 * kDegree * kY);
    expectRotation(motion.theta[0], joint::kHead, 10 * kDegree * kY);
    const glm::dvec3 hip = axisAngle(motion.theta[0], joint::kLeftHip),
                     rest = axisAngle(motion.theta[1], joint::kLeftHip);
    EXPECT_NEAR(hip.x - rest.x, -30 * kDegree, .01);
}

TEST(Bvh, SpreadsTheSpine) {
    for (const int joints : {0, 1, 2, 3, 5}) {
        std::vector<Bone> bones;
        for (Bone bone : person(false)) {
            if (bone.name.starts_with("Spine")) continue;
            if (bone.parent.starts_with("Spine"))
                bone.parent = joints ? fmt::format("Spine{}", joints) : "Hips";
            bones.push_back(bone);
            if (bone.name != "Hips") continue;
            for (int i = 1; i <= joints; ++i)
                bones.push_back({fmt::format("Spine{}", i),
                                 i == 1 ? "Hips" : fmt::format("Spine{}", i - 1),
                                 {0, .36 / joints, 0}});
        }
        Angles angles;
        for (int i = 1; i <= joints; ++i)
            angles[fmt::format("Spine{}", i)] = turn(30. / joints, kX);
        const Motion motion = motionOf(bvhText(bones, {angles}, {{0, .95, 0}}));
        for (size_t j : {joint::kSpine1, joint::kSpine2, joint::kSpine3})
            expectRotation(motion.theta[0], j, (joints ? 10 : 0) * kDegree * kX);
        expectRotation(motion.theta[0], joint::kNeck, glm::dvec3(0));
        expectRotation(motion.theta[0], joint::kLeftShoulder, glm::dvec3(0), 1e-3);
    }
}

// Offsets along each bone's own axis and turns from one to the next, as game engines have them.
TEST(Bvh, ReadsSkeletonsOfTheirOwnAxes) {
    const std::vector<Bone> bones = person(false);
    std::vector<Angles> frames = {
        {{"LeftArm", turn(-50, kZ)}, {"RightLeg", turn(80, kX)}, {"Spine1", turn(20, kX)}},
        {},  // the T-pose, somewhere in between
        {{"Hips", turn(70, kY)}, {"LeftForeArm", turn(-90, kY)}, {"Head", turn(30, kY)}},
    };
    const std::vector<glm::dvec3> places = {{.1, .9, .2}, {0, .95, 0}, {-.3, .95, 1}};
    const Motion expected = motionOf(bvhText(bones, frames, places));
    std::map<std::string, glm::dquat> axes;
    for (const Bone& bone : bones) {
        // Along x where the next bone is; a made-up roll about it.
        glm::dvec3 way(0, 1, 0);
        for (const Bone& child : bones)
            if (child.parent == bone.name) way = glm::normalize(child.offset);
        const glm::dvec3 axis = glm::cross(kX, way);
        const double sine = glm::length(axis);
        axes[bone.name] = (sine > 1e-9 ? quaternionOf(axis / sine * std::acos(way.x))
                           : way.x > 0 ? turn(0, kX)
                                       : turn(180, kZ)) *
                          turn(double(axes.size()) * 31, kX);
    }
    std::vector<Bone> own;
    std::vector<Angles> turned(frames.size());
    for (const Bone& bone : bones) {
        const glm::dquat above = bone.parent.empty() ? turn(0, kX) : axes[bone.parent];
        own.push_back({bone.name, bone.parent, glm::conjugate(above) * bone.offset});
        for (size_t f = 0; f < frames.size(); ++f) {
            const auto found = frames[f].find(bone.name);
            const glm::dquat local = found == frames[f].end() ? turn(0, kX) : found->second;
            turned[f][bone.name] = glm::conjugate(above) * local * axes[bone.name];
        }
    }
    const Motion motion = motionOf(bvhText(own, turned, places));
    for (size_t f = 0; f < frames.size(); ++f) {
        for (size_t j = 0; j < joint::kCount; ++j)
            expectRotation(motion.theta[f], j, axisAngle(expected.theta[f], j), 1e-3);
        for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(motion.trans[f][c], expected.trans[f][c], 1e-3);
    }
}

TEST(Bvh, GuessesTheUnit) {
    const std::vector<glm::dvec3> places = {{0, .95, 0}, {1, .9, -2}};
    std::optional<Motion> metres;
    for (const double unit : {1., .01, .0254, .056444, 3.}) {
        for (const bool six : {false, true}) {
            Writing writing;
            writing.unit = unit, writing.sixEverywhere = six;
            const Motion found = motionOf(bvhText(person(false), {{}, {}}, places, writing));
            if (!metres) metres = found;
            for (size_t f = 0; f < 2; ++f)
                for (size_t c = 0; c < 3; ++c)
                    EXPECT_NEAR(found.trans[f][c], metres->trans[f][c], 1e-5) << unit;
        }
    }
    // Legs of .8 m here, of .755 m there: steps are as much shorter, and feet stay on the ground.
    EXPECT_NEAR(metres->trans[1][2] - metres->trans[0][2], -2 * .7551 / .8, 2e-3);
    EXPECT_NEAR(metres->trans[0][1] - .223 - .0603, (.95 - .05) * .7551 / .8, 2e-3);
}

}  // namespace
}  // namespace doppel
