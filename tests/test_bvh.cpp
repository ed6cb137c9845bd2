#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>

#include "engine/error.h"
#include "nn/body/body.h"
#include "nn/body/joint.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/rendering.h"
#include "trainer/motion/bvh.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

constexpr double kDegree = 3.14159265358979323846 / 180;

// A skeleton for a test: joints by name, parents by name, offsets, and the frames' angles by name.
struct Bone {
    std::string name, parent;
    glm::dvec3 offset;
};
using Angles = std::map<std::string, glm::dquat>;  // of one frame; missing: none

glm::dquat turn(double degrees, const glm::dvec3& axis) {
    return quaternionOf(degrees * kDegree * axis);
}
const glm::dvec3 kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);

// Degrees about the order's three axes whose product is the rotation.
glm::dvec3 anglesOf(const glm::dquat& q, const std::string& order) {
    const glm::dmat3 m = glm::mat3_cast(q);
    const auto at = [&](int row, int column) { return m[column][row]; };
    if (order == "ZXY")
        return glm::dvec3(std::atan2(-at(0, 1), at(1, 1)), std::asin(at(2, 1)),
                          std::atan2(-at(2, 0), at(2, 2))) /
               kDegree;
    if (order == "XYZ")
        return glm::dvec3(std::atan2(-at(1, 2), at(2, 2)), std::asin(at(0, 2)),
                          std::atan2(-at(0, 1), at(0, 0))) /
               kDegree;
    EXPECT_EQ(order, "ZYX");
    return glm::dvec3(std::atan2(at(1, 0), at(0, 0)), -std::asin(at(2, 0)),
                      std::atan2(at(2, 1), at(2, 2))) /
           kDegree;
}

struct Writing {
    std::string order = "ZXY", frameTime = "0.0333333";
    double unit = 1;  // of the file in those of the bones
    bool sixEverywhere = false;
};

// The first bone is the root, whose place in each frame is `places`.
std::string bvhText(const std::vector<Bone>& bones, const std::vector<Angles>& frames,
                    const std::vector<glm::dvec3>& places, const Writing& writing = {}) {
    std::vector<std::string> order;  // of the channels
    std::string text = "HIERARCHY\n";
    const std::function<void(const Bone&, int)> write = [&](const Bone& bone, int depth) {
        const std::string indent(size_t(depth), '\t');
        order.push_back(bone.name);
        const glm::dvec3 offset = bone.offset / writing.unit;
        text += fmt::format("{}{} {}\n{}{{\n{}\tOFFSET {:.9g} {:.9g} {:.9g}\n", indent,
                            bone.parent.empty() ? "ROOT" : "JOINT", bone.name, indent, indent,
                            offset.x, offset.y, offset.z);
        const bool six = bone.parent.empty() || writing.sixEverywhere;
        text += fmt::format("{}\tCHANNELS {}{} {}rotation {}rotation {}rotation\n", indent,
                            six ? 6 : 3, six ? " Xposition Yposition Zposition" : "",
                            writing.order[0], writing.order[1], writing.order[2]);
        bool leaf = true;
        for (const Bone& child : bones) {
            if (child.parent != bone.name) continue;
            leaf = false;
            write(child, depth + 1);
        }
        if (leaf)
            text += fmt::format("{}\tEnd Site\n{}\t{{\n{}\t\tOFFSET 0 0 0\n{}\t}}\n", indent,
                                indent, indent, indent);
        text += indent + "}\n";
    };
    write(bones[0], 0);
    text += fmt::format("MOTION\nFrames: {}\nFrame Time: {}\n", frames.size(), writing.frameTime);
    for (size_t f = 0; f < frames.size(); ++f) {
        for (const std::string& name : order) {
            const auto bone = std::find_if(bones.begin(), bones.end(),
                                           [&](const Bone& b) { return b.name == name; });
            const bool root = bone->parent.empty();
            if (root || writing.sixEverywhere) {
                const glm::dvec3 p = (root ? places[f] : bone->offset) / writing.unit;
                text += fmt::format("{:.9g} {:.9g} {:.9g} ", p.x, p.y, p.z);
            }
            const auto found = frames[f].find(name);
            const glm::dvec3 a =
                found == frames[f].end() ? glm::dvec3(0) : anglesOf(found->second, writing.order);
            text += fmt::format("{:.9g} {:.9g} {:.9g} ", a.x, a.y, a.z);
        }
        text += "\n";
    }
    return text;
}

// A simple person of metres with names as Mixamo has them, arms in a T or hanging down.
std::vector<Bone> person(bool armsDown) {
    std::vector<Bone> bones = {{"Hips", "", {0, .95, 0}},        {"Spine", "Hips", {0, .1, 0}},
                               {"Spine1", "Spine", {0, .12, 0}}, {"Spine2", "Spine1", {0, .12, 0}},
                               {"Neck", "Spine2", {0, .2, 0}},   {"Head", "Neck", {0, .1, 0}}};
    for (const double side : {1., -1.}) {
        const std::string s = side > 0 ? "Left" : "Right";
        const auto arm = [&](double length) {
            return armsDown ? glm::dvec3(0, -length, 0) : glm::dvec3(side * length, 0, 0);
        };
        bones.insert(bones.end(), {{s + "UpLeg", "Hips", {side * .09, -.05, 0}},
                                   {s + "Leg", s + "UpLeg", {0, -.4, 0}},
                                   {s + "Foot", s + "Leg", {0, -.4, 0}},
                                   {s + "ToeBase", s + "Foot", {0, -.06, .14}},
                                   {s + "Shoulder", "Spine2", {side * .05, .12, 0}},
                                   {s + "Arm", s + "Shoulder", {side * .12, 0, 0}},
                                   {s + "ForeArm", s + "Arm", arm(.28)},
                                   {s + "Hand", s + "ForeArm", arm(.25)},
                                   {s + "HandMiddle1", s + "Hand", arm(.09)}});
    }
    return bones;
}

Motion motionOf(const std::string& text) {
    Motion motion = motionFromBvh(bvhFromText(text, "test.bvh"));
    EXPECT_TRUE(motion.cameras.empty());
    EXPECT_EQ(motion.betas, Betas{});
    return motion;
}

glm::dvec3 axisAngle(const Theta& theta, size_t joint) {
    return axisAngleOf(jointRotation(theta, joint));
}
void expectRotation(const Theta& theta, size_t joint, const glm::dvec3& expected,
                    double tolerance = 1e-4) {
    const double away = glm::length(
        axisAngleOf(jointRotation(theta, joint) * glm::conjugate(quaternionOf(expected))));
    const glm::dvec3 found = axisAngle(theta, joint);
    EXPECT_LT(away, tolerance) << jointName(joint) << ": found " << found.x << " " << found.y << " "
                               << found.z << ", expected " << expected.x << " " << expected.y << " "
                               << expected.z;
}

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

TEST(Bvh, KeepsTheWorldOfTheFile) {
    // The same person standing along z, as some programs write; and looking along −z and x.
    for (const glm::dquat& world :
         {turn(90, kX), turn(180, kY), turn(90, kY), turn(-90, kY) * turn(90, kX)}) {
        std::vector<Bone> bones = person(true);
        for (Bone& bone : bones) bone.offset = world * bone.offset;
        const Angles angles = {{"LeftArm", world * turn(40, kZ) * glm::conjugate(world)},
                               {"Hips", world * turn(25, kY) * glm::conjugate(world)}};
        const Motion motion = motionOf(bvhText(bones, {angles}, {world * glm::dvec3(.1, .95, .2)}));
        const Motion upright = motionOf(bvhText(
            person(true), {{{"LeftArm", turn(40, kZ)}, {"Hips", turn(25, kY)}}}, {{.1, .95, .2}}));
        for (size_t j = 1; j < joint::kCount; ++j)
            expectRotation(motion.theta[0], j, axisAngle(upright.theta[0], j));
        expectRotation(motion.theta[0], 0, axisAngleOf(world * jointRotation(upright.theta[0], 0)));
        const glm::dvec3 pelvis(0, -.223, .028);
        const auto place = [](const Trans& t) { return glm::dvec3(t[0], t[1], t[2]); };
        EXPECT_LT(glm::length(place(motion.trans[0]) + pelvis -
                              world * (place(upright.trans[0]) + pelvis)),
                  1e-5);
    }
}

TEST(Bvh, GivesASmplMotionBack) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const std::vector<double> rest = restJoints(body, std::vector<double>(10, 0.));
    const auto restOf = [&](size_t j) {
        return glm::dvec3(rest[3 * j], rest[3 * j + 1], rest[3 * j + 2]);
    };
    std::vector<Bone> bones;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const int parent = body.parents[j];
        bones.push_back({jointName(j), parent < 0 ? "" : jointName(size_t(parent)),
                         parent < 0 ? restOf(j) : restOf(j) - restOf(size_t(parent))});
    }
    std::vector<MotionFrame> session = actorSession(8, 8, 3);
    for (const MotionFrame& frame : greeting(12, 2.5f)) session.push_back(frame);
    std::vector<Angles> frames;
    std::vector<glm::dvec3> places;
    for (MotionFrame& frame : session) {
        // All joints in motion, toes and knuckles too.
        for (size_t i = 3; i < 72; ++i) frame.theta[i] += .2f * std::sin(float(i * 7 % 11));
        Angles angles;
        for (size_t j = 0; j < joint::kCount; ++j)
            angles[jointName(j)] = jointRotation(frame.theta, j);
        frames.push_back(angles);
        places.push_back(restOf(0) + glm::dvec3(frame.trans[0], frame.trans[1], frame.trans[2]));
    }
    Folder folder;
    for (const char* order : {"ZXY", "XYZ", "ZYX"}) {
        Writing writing;
        writing.order = order, writing.frameTime = "0.04";
        folder.write("smpl.BVH", bvhText(bones, frames, places, writing));
        const Motion motion = readMotion(folder / "smpl.BVH");
        EXPECT_EQ(motion.fps, 25);
        EXPECT_EQ(motion.name, "smpl");
        EXPECT_EQ(motion.source, folder / "smpl.BVH");
        ASSERT_EQ(motion.size(), session.size());
        for (size_t f = 0; f < session.size(); ++f) {
            for (size_t j = 0; j < joint::kCount; ++j)
                expectRotation(motion.theta[f], j, axisAngle(session[f].theta, j), 1e-3);
            for (size_t c = 0; c < 3; ++c)
                EXPECT_NEAR(motion.trans[f][c], session[f].trans[c], 1e-3);
        }
    }
}

TEST(Bvh, StandsUprightBeforeACamera) {
    const std::vector<Angles> frames = {{{"Hips", turn(25, kY)}}, {{"Hips", turn(40, kY)}}};
    for (const glm::dquat& world : {turn(0, kX), turn(90, kX)}) {
        std::vector<Bone> bones = person(false);
        for (Bone& bone : bones) bone.offset = world * bone.offset;
        std::vector<Angles> turned = frames;
        for (Angles& angles : turned)
            angles["Hips"] = world * angles["Hips"] * glm::conjugate(world);
        const Motion motion = motionOf(bvhText(
            bones, turned, {world * glm::dvec3(0, .95, 0), world * glm::dvec3(.5, .95, 0)}));
        // What other poses without cameras get: y is up for exports, down before a camera.
        const Motion seen = inCameraSpace(motion);
        for (size_t f = 0; f < 2; ++f) {
            const glm::dvec3 up = jointRotation(motion.theta[f], 0) * kY;
            EXPECT_GT((uprightRotation(motion) * up).y, .99);
            EXPECT_LT((jointRotation(seen.theta[f], 0) * kY).y, -.99);
            // It still looks to the side it looked to, at the camera.
            EXPECT_LT((jointRotation(seen.theta[f], 0) * kZ).z, -.7);
            for (size_t i = 3; i < 72; ++i) EXPECT_EQ(seen.theta[f][i], motion.theta[f][i]);
        }
        EXPECT_NEAR(seen.trans[1][0] - seen.trans[0][0], .5 * .7551 / .8, .02);
        EXPECT_NEAR(seen.trans[1][1] - seen.trans[0][1], 0, .02);
        // The pelvis as high above the origin as in the file: y is down now.
        EXPECT_NEAR(-(seen.trans[0][1] - .223), .9 * .7551 / .8 + .0603, 5e-3);
        EXPECT_EQ(inCameraSpace(seen).theta, seen.theta);
    }
}

TEST(Bvh, ReadsFrameTimes) {
    const auto fpsOf = [](const char* frameTime) {
        Writing writing;
        writing.frameTime = frameTime;
        return motionOf(bvhText(person(false), {{}}, {{0, 1, 0}}, writing)).fps;
    };
    EXPECT_EQ(fpsOf(".0333333"), 30);
    EXPECT_EQ(fpsOf("0.008333"), 120);
    EXPECT_EQ(fpsOf("1"), 1);
    EXPECT_NEAR(fpsOf("0.033367"), 29.97, .001);
}

TEST(Bvh, IsPatientWithLayouts) {
    // Tabs, carriage returns, a byte order mark, braces on the line of the name, colons apart,
    // exponents, plus signs, small letters, empty lines, no line at the end.
    std::string text = bvhText(person(false), {{}, {}}, {{0, 1, 0}, {0, 2, 0}});
    const Motion expected = motionOf(text);
    const auto replaceAll = [](std::string s, const std::string& from, const std::string& to) {
        for (size_t at = 0; (at = s.find(from, at)) != std::string::npos; at += to.size())
            s.replace(at, from.size(), to);
        return s;
    };
    text = replaceAll(text, "Frames: 2\n", "Frames :\t2\n");
    text = replaceAll(text, "Frame Time: 0.0333333", "frame time:+3.33333E-2");
    text = replaceAll(text, "ROOT Hips\n{", "root Hips {");
    text = replaceAll(text, "End Site", "end site");
    text = replaceAll(text, "\n", "\r\n\r\n");
    text = "\xef\xbb\xbf" + text;
    while (text.ends_with("\n") || text.ends_with("\r") || text.ends_with(" ")) text.pop_back();
    const Motion found = motionOf(text);
    EXPECT_EQ(found.theta, expected.theta);
    EXPECT_EQ(found.trans, expected.trans);
    EXPECT_EQ(found.fps, expected.fps);
}

TEST(Bvh, RefusesWhatIsNone) {
    const std::string good = bvhText(person(false), {{}, {}}, {{0, 1, 0}, {0, 1, 0}});
    const auto with = [&](const std::string& from, const std::string& to) {
        std::string text = good;
        const size_t at = text.find(from);
        EXPECT_NE(at, std::string::npos) << from;
        return text.replace(at, from.size(), to);
    };
    // The line of MOTION is the first; counted from there.
    const auto line = [&](int number) {
        const auto before =
            std::count(good.begin(), good.begin() + std::ptrdiff_t(good.find("MOTION")), '\n');
        return fmt::format("test.bvh: line {}", before + number);
    };
    std::string deep = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n";
    for (int i = 0; i < 100000; ++i) deep += "JOINT a\n{\nOFFSET 0 0 0\n";
    std::string many = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n";
    for (int i = 0; i < 100000; ++i) many += "JOINT a\n{\nOFFSET 0 0 0\n}\n";
    const std::vector<std::pair<std::string, std::string>> cases = {
        {"", "test.bvh: line 1: expected HIERARCHY, found the end of the file"},
        {"MOTION", "test.bvh: line 1: expected HIERARCHY, found \"MOTION\""},
        {"HIERARCHY\nJOINT a", "test.bvh: line 2: expected ROOT, found \"JOINT\""},
        {"HIERARCHY\nROOT {",
         "test.bvh: line 2: expected a joint's name of 1 to 128 bytes, "
         "found \"\""},
        {"HIERARCHY\nROOT " + std::string(1000000, 'x'),
         "test.bvh: line 2: expected a joint's name of 1 to 128 bytes, found "
         "\"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx…\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0",
         "test.bvh: line 4: expected a number of an OFFSET, "
         "found the end of the file"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 nan",
         "test.bvh: line 4: expected a number of an OFFSET, found \"nan\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 1e300",
         "test.bvh: line 4: expected a number of an OFFSET, found \"1e300\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Yrotation Wrotation",
         "test.bvh: line 5: expected a channel such as Xrotation, found \"Wrotation\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 2 Xrotation Xrotation",
         "test.bvh: line 5: expected each channel once, found Xrotation twice"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 4000000000",
         "test.bvh: line 5: expected the number of CHANNELS, found \"4000000000\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 7 Xrotation",
         "test.bvh: line 5: expected 0 to 6 CHANNELS, found 7"},
        {"HIERARCHY\nROOT a\n{\nCHANNELS 0\n}",
         "test.bvh: line 5: expected an OFFSET in a, found none"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n}",
         "test.bvh: line 5: expected CHANNELS, found no joint that has any"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nROOT b",
         "test.bvh: line 5: expected JOINT within a joint, found ROOT"},
        {deep, "test.bvh: line 1538: expected joints nested at most 512 deep, found more"},
        {many, "test.bvh: line 16385: expected at most 4096 joints, found more"},
        {good.substr(0, 700),
         "test.bvh: line 36: expected OFFSET, CHANNELS, JOINT, End Site or }, "
         "found the end of the file"},
        {with("MOTION", "ROOT b"), line(1) + ": expected MOTION, found \"ROOT\""},
        {with("Frames: 2", "Frames: 0"), line(2) + ": expected Frames: 1 or more, found 0"},
        {with("Frames: 2", "Frames: two"), line(2) + ": expected Frames: a number, found \"two\""},
        {with("Frames: 2", "Frames: 3") + std::string(1000, ' '),
         line(6) + ": expected 3 frames, as Frames says, found 2"},
        {with("Frames: 2", "Frames: 1"),
         line(5) + ": expected 1 frames, as Frames says, found more: \"0\""},
        {with("Frames: 2", "Frames: 900000000"),
         line(3) + ": expected 900000000 frames of 75 numbers, found 303 bytes for them"},
        {with("Frame Time: 0.0333333", "Frame Time: 0"),
         line(3) + ": expected a Frame Time from 0.0001 to 3600 seconds, found 0"},
        {with("Frame Time: 0.0333333", "Frame Time: -1"),
         line(3) + ": expected a Frame Time from 0.0001 to 3600 seconds, found -1"},
        {with("0 1 0 0 0 0", "0 1 0 0 0 0 7"),
         line(4) + ": expected 75 numbers, one for each channel, found more"},
        {with("0 1 0 0 0 0", "0 1 0 0 0"),
         line(4) + ": expected 75 numbers, one for each channel, found 74"},
        {with("0 1 0 0 0 0", "0 1 0 0 inf 0"), line(4) + ": expected a number, found \"inf\""},
        {with("JOINT LeftUpLeg", "JOINT Tail"),
         "test.bvh: expected a person's joints, with names such as LeftUpLeg, LeftLeg, LeftArm, "
         "LeftForeArm, found none for left_hip among Hips, Spine, Spine1, Spine2, Neck, Head, "
         "LeftShoulder, LeftArm, LeftForeArm, LeftHand, LeftHandMiddle1, RightShoulder…"},
        {with("JOINT LeftLeg", "JOINT LeftHand"), ""},
    };
    for (const auto& [text, sentence] : cases) {
        const std::string found =
            messageOf<InputError>([&] { motionFromBvh(bvhFromText(text, "test.bvh")); });
        if (!sentence.empty()) {
            EXPECT_EQ(found, sentence);
        }
        EXPECT_EQ(found.find('\n'), std::string::npos);
    }

    // Rest poses that no person takes.
    std::vector<Bone> flat = person(false);
    for (Bone& bone : flat) bone.offset = glm::dvec3(0, glm::length(bone.offset), 0);
    EXPECT_NE(messageOf<InputError>([&] {
                  motionOf(bvhText(flat, {{}}, {{0, 1, 0}}));
              }).find("test.bvh: OFFSET: expected a rest pose, or any frame, in which"),
              std::string::npos);
    for (Bone& bone : flat) bone.offset = glm::dvec3(0);
    EXPECT_EQ(messageOf<InputError>([&] {
                  motionOf(bvhText(flat, {{}}, {{0, 1, 0}}));
              }),
              "test.bvh: OFFSET: expected legs of some length, found none");
    // Legs that do not hang together.
    std::vector<Bone> apart = person(false);
    for (Bone& bone : apart)
        if (bone.name == "LeftLeg") bone.parent = "RightUpLeg";
    EXPECT_EQ(messageOf<InputError>([&] {
                  motionOf(bvhText(apart, {{}}, {{0, 1, 0}}));
              }),
              "test.bvh: expected LeftLeg (for left_knee) below LeftUpLeg (for left_hip), found "
              "it elsewhere");
    Folder folder;
    EXPECT_NE(messageOf<InputError>([&] { readMotion(folder / "none.bvh"); }).find("found nothing"),
              std::string::npos);
    folder.write("poses.bvh", std::string("PK\x03\x04"));
    EXPECT_EQ(messageOf<InputError>([&] { readMotion(folder / "poses.bvh"); }),
              (folder / "poses.bvh").string() + ": line 1: expected HIERARCHY, found \"PK??\"");
}

}  // namespace
}  // namespace doppel
