// Poses of SMPL's body: how they are held in memory and in a poses.npz, joints by name, and
// rotations between the forms in which thetas and formulas hold them.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/files/npz.h"
#include "nn/body/joint.h"

namespace doppel {

using Theta = std::array<float, kThetaSize>;  // axis-angle, joints in SMPL's order, radians
using Trans = std::array<float, 3>;           // metres
using Betas = std::array<float, 10>;          // standard deviations

// The default body's pelvis in the rest pose, metres, which is where SMPL's lies for the mean
// shape. Poses turn about it, so moving them from one space into another takes it.
inline constexpr std::array<double, 3> kRestPelvis{0, -.223, .028};

// "left_wrist"; in snake case, as SMPL's programs write them.
const char* jointName(size_t joint);
std::optional<size_t> jointNumber(std::string_view name);

// ---- rotations ----------------------------------------------------------------------------------

// Axis times angle in radians, as theta holds it, to a unit quaternion and back. The way back gives
// angles from 0 to π, and takes a quaternion of any length.
glm::dquat quaternionOf(const glm::dvec3& axisAngle);
glm::dvec3 axisAngleOf(const glm::dquat& rotation);

// The rotation of one joint of a theta.
glm::dquat jointRotation(const Theta& theta, size_t joint);
void setJointRotation(Theta& theta, size_t joint, const glm::dquat& rotation);

// The smallest turn that makes one unit vector the other.
glm::dquat turnBetween(const glm::dvec3& from, const glm::dvec3& to);

// Poses between two, from `one` at a share of 0 to `other` at 1: along the shortest turn of each
// joint, and a straight line.
Theta thetaBetween(const Theta& one, const Theta& other, double share);
Trans transBetween(const Trans& one, const Trans& other, double share);

// x → rotation x + translation; a capture's extrinsic is one, from the world to the camera.
struct RigidMotion {
    glm::dmat3 rotation{1};
    glm::dvec3 translation{0};
    bool operator==(const RigidMotion&) const = default;
};

// Moves the body v = R(θ0)(v0 − j0) + j0 + trans, where j0 is kRestPelvis.
void movePose(const RigidMotion& by, Theta& theta, Trans& trans);

// ---- files --------------------------------------------------------------------------------------

// What a poses.npz holds: betas [10], global_orient [F,3], body_pose [F,69], transl [F,3].
struct Poses {
    Betas betas{};
    std::vector<Theta> theta;
    std::vector<Trans> trans;
    std::optional<double> fps;  // a 0-d array, which other programs write
};

// InputErrors name the file and the array: shapes, counts that disagree, values that are not
// finite, no frames.
Poses readPoses(const std::filesystem::path& path, bool needBetas);

Npz posesArrays(std::span<const Theta> theta, std::span<const Trans> trans, const Betas& betas);

// Beyond these a number is a mistake, and single precision leaves nothing of the body.
inline constexpr double kMostMetres = 1e6, kMostRadians = 1e4, kMostDeviations = 1e3;

// InputError where a value is not finite, or beyond ±most; what: file and array. perFrame: elements
// of a frame.
void requireFinite(std::span<const float> values, const std::string& what, size_t perFrame,
                   double most = std::numeric_limits<double>::infinity());

}  // namespace doppel
