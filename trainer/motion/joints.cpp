#include "trainer/motion/joints.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr std::array<const char*, joint::kCount> kNames = {
    "pelvis",     "left_hip",    "right_hip",    "spine1",      "left_knee",     "right_knee",
    "spine2",     "left_ankle",  "right_ankle",  "spine3",      "left_foot",     "right_foot",
    "neck",       "left_collar", "right_collar", "head",        "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist",   "right_wrist", "left_hand",     "right_hand"};

}  // namespace

const char* jointName(size_t joint) {
    CHECK(joint < kNames.size(), "joint {} is one of 24", joint);
    return kNames[joint];
}

std::optional<size_t> jointNumber(std::string_view name) {
    const auto at = std::find(kNames.begin(), kNames.end(), name);
    if (at == kNames.end()) return {};
    return static_cast<size_t>(at - kNames.begin());
}

size_t oppositeJoint(size_t joint) {
    const std::string_view name = jointName(joint);
    // SMPL numbers each left joint just before its right one.
    if (name.starts_with("left_")) return joint + 1;
    if (name.starts_with("right_")) return joint - 1;
    return joint;
}

glm::dquat quaternionOf(const glm::dvec3& axisAngle) {
    const double angle = glm::length(axisAngle);
    // sin(a/2)/a, whose limit at 0 is a half.
    const double scale = angle > 1e-9 ? std::sin(angle / 2) / angle : .5;
    return {std::cos(angle / 2), scale * axisAngle.x, scale * axisAngle.y, scale * axisAngle.z};
}

glm::dvec3 axisAngleOf(const glm::dquat& rotation) {
    const double side = rotation.w < 0 ? -1 : 1;
    const glm::dvec3 axis = side * glm::dvec3(rotation.x, rotation.y, rotation.z);
    const double sine = glm::length(axis);
    return axis * (sine > 1e-12 ? 2 * std::atan2(sine, side * rotation.w) / sine : 2.);
}

glm::dquat jointRotation(const Theta& theta, size_t joint) {
    return quaternionOf({theta[3 * joint], theta[3 * joint + 1], theta[3 * joint + 2]});
}

void setJointRotation(Theta& theta, size_t joint, const glm::dquat& rotation) {
    const glm::dvec3 axisAngle = axisAngleOf(rotation);
    for (int k = 0; k < 3; ++k)
        theta[3 * joint + static_cast<size_t>(k)] = static_cast<float>(axisAngle[k]);
}

}  // namespace doppel
