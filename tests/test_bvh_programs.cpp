// BVH in the hierarchies of programs that write it: what hangs on what, in which unit, order and
// world, and from which rest pose. The lengths are made up.
#include <gtest/gtest.h>

#include <map>

#include "nn/body/joint.h"
#include "tests/bvh_text.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"

namespace doppel {
namespace {

using namespace test;

struct Program {
    const char* name;
    std::vector<Bone> bones;           // y up, looking along z, in the file's unit
    std::map<size_t, std::string> of;  // the bone for SMPL's joint
    std::string chest;                 // the last of the spine, below the neck
    std::string rest;                  // as the motion's note calls it
    Writing writing;
    glm::dquat world{1, 0, 0, 0};  // from y up to how the file stands
};

// Names for both sides, of SMPL's left joints: {"LeftArm", …} by "Left", "Right".
std::map<size_t, std::string> sides(const std::string& left, const std::string& right,
                                    const std::map<size_t, std::string>& bases) {
    std::map<size_t, std::string> of;
    for (const auto& [joint, base] : bases) of[joint] = left + base, of[joint + 1] = right + base;
    return of;
}

// Rokoko Studio: a root on the floor above the hips, four spines, thighs and shins; centimetres, a
// T-pose, and each joint has its place in each frame.
Program rokoko() {
    Program p{.name = "Rokoko", .bones = {}, .of = {}, .chest = "Spine4", .rest = "a T-pose"};
    p.bones = {{"Root", "", {0, 0, 0}},          {"Hips", "Root", {0, 98, 0}},
               {"Spine1", "Hips", {0, 9, -1}},   {"Spine2", "Spine1", {0, 9, 0}},
               {"Spine3", "Spine2", {0, 10, 0}}, {"Spine4", "Spine3", {0, 10, 0}},
               {"Neck", "Spine4", {0, 16, 1}},   {"Head", "Neck", {0, 9, 1}}};
    for (const double side : {1., -1.}) {
        const std::string s = side > 0 ? "Left" : "Right";
        p.bones.insert(p.bones.end(), {{s + "Shoulder", "Spine4", {side * 3, 11, 0}},
                                       {s + "Arm", s + "Shoulder", {side * 14, 0, 0}},
                                       {s + "ForeArm", s + "Arm", {side * 29, 0, 0}},
                                       {s + "Hand", s + "ForeArm", {side * 26, 0, 0}},
                                       {s + "Finger3Proximal", s + "Hand", {side * 9, 0, 0}},
                                       {s + "Thigh", "Hips", {side * 9, 0, 0}},
                                       {s + "Shin", s + "Thigh", {0, -44, 0}},
                                       {s + "Foot", s + "Shin", {0, -42, 0}},
                                       {s + "Toe", s + "Foot", {0, -8, 15}}});
    }
    p.of = sides("Left", "Right",
                 {{joint::kLeftCollar, "Shoulder"},
                  {joint::kLeftShoulder, "Arm"},
                  {joint::kLeftElbow, "ForeArm"},
                  {joint::kLeftWrist, "Hand"},
                  {joint::kLeftHip, "Thigh"},
                  {joint::kLeftKnee, "Shin"},
                  {joint::kLeftAnkle, "Foot"},
                  {joint::kLeftFoot, "Toe"}});
    p.of[joint::kPelvis] = "Hips";
    p.of[joint::kHead] = "Head";
    p.writing.sixEverywhere = true;
    return p;
}

// Xsens MVN: chests, collars and joints in the place of bones, hips in the origin, y before x and
// z.
Program xsens() {
    Program p{.name = "Xsens", .bones = {}, .of = {}, .chest = "Chest4", .rest = "a T-pose"};
    p.bones = {{"Hips", "", {0, 0, 0}},          {"Chest", "Hips", {0, 10, 0}},
               {"Chest2", "Chest", {0, 11, 0}},  {"Chest3", "Chest2", {0, 10, 0}},
               {"Chest4", "Chest3", {0, 10, 0}}, {"Neck", "Chest4", {0, 14, 0}},
               {"Head", "Neck", {0, 9, 0}}};
    for (const double side : {-1., 1.}) {
        const std::string s = side > 0 ? "Left" : "Right";
        p.bones.insert(p.bones.end(), {{s + "Collar", "Chest4", {side * 3, 8, 0}},
                                       {s + "Shoulder", s + "Collar", {side * 14, 0, 0}},
                                       {s + "Elbow", s + "Shoulder", {side * 30, 0, 0}},
                                       {s + "Wrist", s + "Elbow", {side * 25, 0, 0}},
                                       {s + "Hip", "Hips", {side * 8.5, 0, 0}},
                                       {s + "Knee", s + "Hip", {0, -42, 0}},
                                       {s + "Ankle", s + "Knee", {0, -43, 0}},
                                       {s + "Toe", s + "Ankle", {0, -9, 17}}});
    }
    p.of = sides("Left", "Right",
                 {{joint::kLeftCollar, "Collar"},
                  {joint::kLeftShoulder, "Shoulder"},
                  {joint::kLeftElbow, "Elbow"},
                  {joint::kLeftWrist, "Wrist"},
                  {joint::kLeftHip, "Hip"},
                  {joint::kLeftKnee, "Knee"},
                  {joint::kLeftAnkle, "Ankle"},
                  {joint::kLeftFoot, "Toe"}});
    p.of[joint::kPelvis] = "Hips";
    p.of[joint::kHead] = "Head";
    p.writing.order = "YXZ";
    return p;
}

// 3ds Max's Biped: its centre of mass above a pelvis of no length, clavicles on the neck, thighs on
// the pelvis or, as older rigs have them, on the spine; inches, z up, an A-pose.
Program biped(const std::string& thighsOn, const std::string& gap) {
    const std::string b = "Bip01" + gap;
    Program p{.name = "3ds Max", .bones = {}, .of = {}, .chest = b + "Spine1", .rest = "an A-pose"};
    p.bones = {{"Bip01", "", {0, 38, 0}},
               {b + "Pelvis", "Bip01", {0, 0, 0}},
               {b + "Spine", b + "Pelvis", {0, 4, 0}},
               {b + "Spine1", b + "Spine", {0, 6, -.3}},
               {b + "Neck", b + "Spine1", {0, 10, 0}},
               {b + "Head", b + "Neck", {0, 4, .5}}};
    for (const double side : {1., -1.}) {
        const std::string s = b + (side > 0 ? "L" : "R") + gap;
        const auto down = [&](double length) {
            return length * std::sqrt(.5) * glm::dvec3(side, -1, 0);
        };
        p.bones.insert(p.bones.end(),
                       {{s + "Clavicle", b + "Neck", {side * 1.2, -1, 0}},
                        {s + "UpperArm", s + "Clavicle", {side * 5.5, -.5, 0}},
                        {s + "Forearm", s + "UpperArm", down(11)},
                        {s + "Hand", s + "Forearm", down(10)},
                        {s + "Finger0", s + "Hand", {side * 1, -1, 1}},
                        {s + "Finger2", s + "Hand", down(3.5)},
                        {s + "Thigh", b + thighsOn, {side * 3.6, thighsOn == "Spine" ? -4. : 0, 0}},
                        {s + "Calf", s + "Thigh", {0, -17, 0}},
                        {s + "Foot", s + "Calf", {0, -17, 0}},
                        {s + "Toe0", s + "Foot", {0, -3, 6}}});
    }
    p.of = sides(b + "L" + gap, b + "R" + gap,
                 {{joint::kLeftCollar, "Clavicle"},
                  {joint::kLeftShoulder, "UpperArm"},
                  {joint::kLeftElbow, "Forearm"},
                  {joint::kLeftWrist, "Hand"},
                  {joint::kLeftHip, "Thigh"},
                  {joint::kLeftKnee, "Calf"},
                  {joint::kLeftAnkle, "Foot"},
                  {joint::kLeftFoot, "Toe0"}});
    p.of[joint::kPelvis] = b + "Pelvis";
    p.of[joint::kHead] = b + "Head";
    p.world = turn(90, kX);
    return p;
}

// Each joint's turn in the world.
std::array<glm::dquat, joint::kCount> turnsOf(const Theta& theta) {
    static const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    std::array<glm::dquat, joint::kCount> turns;
    for (size_t j = 0; j < joint::kCount; ++j) {
        turns[j] = jointRotation(theta, j);
        if (body.parents[j] >= 0) turns[j] = turns[size_t(body.parents[j])] * turns[j];
    }
    return turns;
}

TEST(BvhPrograms, EachBonePointsAndTurnsAsInTheFile) {
    for (const Program& program : {rokoko(), xsens(), biped("Pelvis", " "), biped("Spine", "_")}) {
        SCOPED_TRACE(program.name);
        const auto inWorld = [&](const glm::dquat& q) {
            return program.world * q * glm::conjugate(program.world);
        };
        std::vector<Bone> bones = program.bones;
        for (Bone& bone : bones) bone.offset = program.world * bone.offset;
        // Every joint turns, each time about another axis, and the person walks.
        std::vector<Angles> frames(3);
        std::vector<glm::dvec3> places;
        for (size_t f = 0; f < frames.size(); ++f) {
            for (size_t b = 0; b < bones.size(); ++b)
                frames[f][bones[b].name] =
                    inWorld(turn(5 + double((5 * b + 7 * f) % 20),
                                 glm::normalize(glm::dvec3(std::sin(double(b + f)), .4,
                                                           std::cos(double(b + 2 * f))))));
            places.push_back(program.world *
                             (program.bones[0].offset + glm::dvec3(double(f) * 20, 0, 5)));
        }
        const Bvh bvh = bvhFromText(bvhText(bones, frames, places, program.writing), "test.bvh");
        const Motion motion = motionFromBvh(bvh);
        ASSERT_EQ(motion.size(), frames.size());
        EXPECT_TRUE(motion.note.starts_with(program.rest)) << motion.note;

        const auto numberOf = [&](const std::string& name) {
            const auto at = std::ranges::find(bvh.joints, name, &Bvh::Joint::name);
            EXPECT_NE(at, bvh.joints.end()) << name;
            return size_t(at - bvh.joints.begin());
        };
        const auto theirs = [&](size_t j) { return numberOf(program.of.at(j)); };
        const Bvh::Placement first = bvh.place(0);
        const auto firstTurns = turnsOf(motion.theta[0]);
        const auto firstPlaces = placeJoints(motion.theta[0], motion.trans[0]);
        const auto middle = [](const auto& of, size_t left, size_t right) {
            return .5 * (of[left] + of[right]);
        };
        for (size_t f = 0; f < frames.size(); ++f) {
            const Bvh::Placement placed = bvh.place(int64_t(f));
            const auto turns = turnsOf(motion.theta[f]);
            const auto ours = placeJoints(motion.theta[f], motion.trans[f]);
            for (const auto& [from, to] : {std::pair(joint::kLeftShoulder, joint::kLeftElbow),
                                           {joint::kLeftElbow, joint::kLeftWrist},
                                           {joint::kLeftHip, joint::kLeftKnee},
                                           {joint::kLeftKnee, joint::kLeftAnkle}})
                for (const size_t right : {0u, 1u}) {
                    const glm::dvec3 bone = glm::normalize(ours[to + right] - ours[from + right]),
                                     asked = glm::normalize(placed.position[theirs(to + right)] -
                                                            placed.position[theirs(from + right)]);
                    EXPECT_GT(glm::dot(bone, asked), 1 - 1e-5)
                        << f << ": " << jointName(from + right);
                }
            // How a joint has turned since the first frame.
            const auto expectTurn = [&](size_t ourJoint, size_t theirJoint) {
                const glm::dquat found = turns[ourJoint] * glm::conjugate(firstTurns[ourJoint]),
                                 asked = placed.rotation[theirJoint] *
                                         glm::conjugate(first.rotation[theirJoint]);
                EXPECT_LT(glm::length(axisAngleOf(found * glm::conjugate(asked))), 1e-4)
                    << f << ": " << jointName(ourJoint);
            };
            for (const auto& [ourJoint, name] : program.of) expectTurn(ourJoint, numberOf(name));
            expectTurn(joint::kSpine3, numberOf(program.chest));
            const int neck = bvh.joints[theirs(joint::kHead)].parent;
            expectTurn(joint::kNeck, static_cast<size_t>(neck));
            // The hips go as far as legs of our length carry them.
            const auto leg = [&](const auto& at, size_t hip, size_t knee, size_t ankle) {
                return glm::distance(at[hip], at[knee]) + glm::distance(at[knee], at[ankle]);
            };
            const double scale = leg(ours, joint::kLeftHip, joint::kLeftKnee, joint::kLeftAnkle) /
                                 leg(placed.position, theirs(joint::kLeftHip),
                                     theirs(joint::kLeftKnee), theirs(joint::kLeftAnkle));
            const glm::dvec3 went = middle(ours, joint::kLeftHip, joint::kRightHip) -
                                    middle(firstPlaces, joint::kLeftHip, joint::kRightHip),
                             theyWent = middle(placed.position, theirs(joint::kLeftHip),
                                               theirs(joint::kRightHip)) -
                                        middle(first.position, theirs(joint::kLeftHip),
                                               theirs(joint::kRightHip));
            EXPECT_LT(glm::length(went - scale * theyWent), 1e-5) << f;
        }
    }
}

}  // namespace
}  // namespace doppel
