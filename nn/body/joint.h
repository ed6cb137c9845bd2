// SMPL's 24 joints.
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

constexpr int64_t kJointCount = joint::kCount;
constexpr int64_t kThetaSize = 3 * kJointCount;  // theta: a rotation (axis-angle, rad) per joint

}  // namespace doppel
