#include "trainer/avatar/formats/joint_names.h"

#include <array>

#include "engine/error.h"
#include "engine/files/printable.h"
#include "trainer/data/pose.h"

namespace doppel {

namespace {

// Of each joint VRM's, Mixamo's and Unreal's.
struct Names {
    const char *vrm, *mixamo, *unreal;
};
constexpr std::array<Names, joint::kCount> kNames = {{
    {"hips", "Hips", "pelvis"},
    {"leftUpperLeg", "LeftUpLeg", "thigh_l"},
    {"rightUpperLeg", "RightUpLeg", "thigh_r"},
    {"spine", "Spine", "spine_01"},
    {"leftLowerLeg", "LeftLeg", "calf_l"},
    {"rightLowerLeg", "RightLeg", "calf_r"},
    {"chest", "Spine1", "spine_02"},
    {"leftFoot", "LeftFoot", "foot_l"},
    {"rightFoot", "RightFoot", "foot_r"},
    {"upperChest", "Spine2", "spine_03"},
    {"leftToes", "LeftToeBase", "ball_l"},
    {"rightToes", "RightToeBase", "ball_r"},
    {"neck", "Neck", "neck_01"},
    {"leftShoulder", "LeftShoulder", "clavicle_l"},
    {"rightShoulder", "RightShoulder", "clavicle_r"},
    {"head", "Head", "head"},
    {"leftUpperArm", "LeftArm", "upperarm_l"},
    {"rightUpperArm", "RightArm", "upperarm_r"},
    {"leftLowerArm", "LeftForeArm", "lowerarm_l"},
    {"rightLowerArm", "RightForeArm", "lowerarm_r"},
    {"leftHand", "LeftHand", "hand_l"},
    {"rightHand", "RightHand", "hand_r"},
    {"leftMiddleProximal", "LeftHandMiddle1", "middle_01_l"},
    {"rightMiddleProximal", "RightHandMiddle1", "middle_01_r"},
}};

}  // namespace

JointNames jointNamesByWord(std::string_view word, std::string_view where) {
    if (word == "smpl") return JointNames::Smpl;
    if (word == "vrm") return JointNames::Vrm;
    if (word == "mixamo") return JointNames::Mixamo;
    if (word == "unreal") return JointNames::Unreal;
    throwInput("{}: expected smpl, vrm, mixamo or unreal, found \"{}\"", where, printable(word));
}

std::string jointNameFor(JointNames names, size_t joint) {
    switch (names) {
        case JointNames::Smpl:
            break;
        case JointNames::Vrm:
            return kNames.at(joint).vrm;
        case JointNames::Mixamo:
            return std::string("mixamorig:") + kNames.at(joint).mixamo;
        case JointNames::Unreal:
            return kNames.at(joint).unreal;
    }
    return jointName(joint);
}

}  // namespace doppel
