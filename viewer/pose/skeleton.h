// The skeleton that is dragged: SMPL's joints in double precision, poses, and how far human joints
// turn.
//
// Poses mean what nn/ops/body.h makes of them: G_j = G_parent R(rotation_j), a joint stands at its
// parent's place plus G_parent (rest_j − rest_parent), the pelvis at rest_0 + trans.
#pragma once

#include <array>
#include <cstddef>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <optional>

#include "nn/body/body.h"
#include "trainer/data/pose.h"

namespace doppel {

// Joints of the unposed body, metres: y up, x to the body's left, z forward.
struct Skeleton {
    std::array<int, joint::kCount> parents;  // −1 for the pelvis, else less than the joint
    std::array<glm::dvec3, joint::kCount> rest;

    // Whether `joint` is `root` or hangs on it.
    bool hangsOn(size_t joint, size_t root) const;
};
Skeleton skeletonOf(const BodyModel& body, const Betas& betas);

struct Pose {
    std::array<glm::dvec3, joint::kCount> rotation{};  // axis-angle, each in its parent's frame
    glm::dvec3 trans{};                                // metres
    bool operator==(const Pose&) const = default;
};
Pose poseOf(const Theta& theta, const Trans& trans);
Theta thetaOf(const Pose& pose);
Trans transOf(const Pose& pose);
bool isFinite(const Pose& pose);

struct PosedSkeleton {
    std::array<glm::dvec3, joint::kCount> position;
    std::array<glm::dmat3, joint::kCount> rotation;  // of the joint's frame, G_j
};
PosedSkeleton forwardKinematics(const Skeleton& skeleton, const Pose& pose);

// ---- editing ------------------------------------------------------------------------------------

// The pose in which the joint is turned further by `angle` about an axis in the world, through the
// joint. Only its own rotation changes, so what hangs on it turns along. Where axis or angle are
// not finite, or the axis has no length, the pose as it is.
Pose rotateJoint(const Skeleton& skeleton, const Pose& pose, size_t joint, const glm::dvec3& axis,
                 double angle);

// The joint as it is in `original`; the pelvis with its place.
Pose resetJoint(const Pose& pose, size_t joint, const Pose& original);

// Left and right exchanged: the body reflected in the plane that parts it in two, set upright (it
// holds the direction of the y axis, which is up or down in every space that poses live in). So it
// heads where it headed, stands where it stood, and a lean to the left becomes one to the right. A
// body lying on its side has no such plane and keeps the pelvis as it is. Twice is the pose again.
Pose mirrored(const Pose& pose);

// Symmetric editing: what was done to the limb that ends in `joint`, done to the one across. Of the
// joints from `joint` up to where both limbs hang on the trunk, those whose rotation is not that of
// `began` have its mirror image on the other side. A joint in the middle has no other side.
Pose mirroredAcross(const Skeleton& skeleton, const Pose& pose, const Pose& began, size_t joint);
// The mirror image of a place, in the plane that parts the body in two where the joint's limb hangs
// on the trunk, as that is posed. Metres, the pose's space.
glm::dvec3 placeAcross(const Skeleton& skeleton, const PosedSkeleton& posed, size_t joint,
                       const glm::dvec3& place);
// One side's rotations, mirrored, on the other; what is in the middle stays.
Pose sideCopied(const Pose& pose, bool leftToRight);

// ---- limbs --------------------------------------------------------------------------------------

enum class Limb { LeftArm, RightArm, LeftLeg, RightLeg };
constexpr size_t kLimbs = 4;
// All joints as an animator lists them: from the pelvis to the head, then limb by limb from the
// trunk outwards.
const std::array<size_t, joint::kCount>& jointsByLimb();
// The limb in that list, which collars and hips belong to; nothing for trunk and head.
std::optional<Limb> limbOfTree(size_t joint);
// The limb of which the joint is dragged; nothing for the trunk, collars and hips.
std::optional<Limb> limbOf(const Skeleton& skeleton, size_t joint);

// The pose in which the joint's parent alone has turned, by the shortest way, so that the bone to
// the joint points at `goal`: a drag with forward kinematics. As it is where the bone or the way
// has no length.
Pose pointBone(const Skeleton& skeleton, const Pose& pose, size_t joint, const glm::dvec3& goal);

// ---- limits -------------------------------------------------------------------------------------

// Every joint but the pelvis within the ranges of human joints (listed in skeleton.cpp). `began` is
// where an edit began: what was beyond a range there may stay so but goes no further out, so that
// a pose from a capture does not jump when it is touched.
Pose clampToLimits(const Pose& pose, const Pose& began);
Pose clampToLimits(const Pose& pose);

// The same for one joint's rotation in its parent's frame.
glm::dquat clampJoint(size_t joint, const glm::dquat& rotation, const glm::dquat& began);

// How far beyond its limits a rotation is, in radians: along the twist about the bone, and along
// one or two directions in which the bone swings. Negative inside; what clampJoint keeps from
// growing positive. −π where a joint has no such limit.
std::array<double, 3> beyondLimits(size_t joint, const glm::dquat& rotation,
                                   const glm::dquat& began);

// Elbows and knees.
bool isHinge(size_t joint);

// How a hinge is bent: by `flexion` about `axis`, the human way where it is positive, and
// `sideways` about an axis across, both in the parent's frame.
struct Bend {
    double flexion = 0, sideways = 0;  // radians
    glm::dvec3 axis{}, across{};
};
Bend bendOf(size_t hinge, const glm::dquat& rotation);

}  // namespace doppel
