// SMPL's joints by name, and rotations between the forms in which thetas and formulas hold them.
#pragma once

#include <array>
#include <cstddef>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <optional>
#include <string_view>

#include "nn/body/joint.h"
#include "trainer/data/capture.h"

namespace doppel {

// The default body's pelvis in the rest pose, metres, which is where SMPL's lies for the mean
// shape. Poses turn about it, so moving them from one space into another takes it.
inline constexpr std::array<double, 3> kRestPelvis{0, -.223, .028};

// "left_wrist"; in snake case, as SMPL's programs write them.
const char* jointName(size_t joint);
std::optional<size_t> jointNumber(std::string_view name);

// The joint on the other side; of those in the middle, the joint itself.
size_t oppositeJoint(size_t joint);

// Axis times angle in radians, as theta holds it, to a unit quaternion and back. The way back gives
// angles from 0 to π.
glm::dquat quaternionOf(const glm::dvec3& axisAngle);
glm::dvec3 axisAngleOf(const glm::dquat& rotation);

// The rotation of one joint of a theta.
glm::dquat jointRotation(const Theta& theta, size_t joint);
void setJointRotation(Theta& theta, size_t joint, const glm::dquat& rotation);

}  // namespace doppel
