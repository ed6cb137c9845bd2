// SMPL's 24 joints, and the parts of its surface.
#pragma once

#include <cstddef>
#include <cstdint>

namespace doppel {

// Numbers of the joints, in SMPL's order. Left and right are the body's own.
namespace joint {
enum Number : size_t {
    kPelvis,
    kLeftHip,
    kRightHip,
    kSpine1,
    kLeftKnee,
    kRightKnee,
    kSpine2,
    kLeftAnkle,
    kRightAnkle,
    kSpine3,
    kLeftFoot,  // where the toes begin
    kRightFoot,
    kNeck,
    kLeftCollar,
    kRightCollar,
    kHead,
    kLeftShoulder,
    kRightShoulder,
    kLeftElbow,
    kRightElbow,
    kLeftWrist,
    kRightWrist,
    kLeftHand,  // the knuckles
    kRightHand,
    kCount,
};
}  // namespace joint

// The joint on the other side; of those in the middle, the joint itself.
constexpr size_t oppositeJoint(size_t joint) {
    constexpr size_t kLefts[] = {joint::kLeftHip,   joint::kLeftKnee,   joint::kLeftAnkle,
                                 joint::kLeftFoot,  joint::kLeftCollar, joint::kLeftShoulder,
                                 joint::kLeftElbow, joint::kLeftWrist,  joint::kLeftHand};
    for (const size_t left : kLefts) {
        // SMPL numbers each left joint just before its right one.
        if (joint == left) return left + 1;
        if (joint == left + 1) return left;
    }
    return joint;
}

constexpr int64_t kJointCount = joint::kCount;
constexpr int64_t kThetaSize = 3 * kJointCount;  // theta: a rotation (axis-angle, rad) per joint

// Labels of BodyModel::part; 0 is none of them.
enum BodyPart : uint8_t {
    kHead = 1,  // and neck
    kTorso,
    kLeftUpperArm,
    kRightUpperArm,
    kLeftForearm,
    kRightForearm,
    kLeftThigh,
    kRightThigh,
    kLeftCalf,
    kRightCalf,
    kLeftFoot,
    kRightFoot,
    kLeftHand,
    kRightHand,
    kBodyPartEnd,
};

// Points of a face: those of MediaPipe's Face Mesh, in its order.
inline constexpr size_t kFacePoints = 468;

}  // namespace doppel
