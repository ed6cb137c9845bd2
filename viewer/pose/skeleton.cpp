#include "viewer/pose/skeleton.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "nn/body/human_joints.h"

namespace doppel {

namespace {

constexpr glm::dvec3 kX(1, 0, 0), kY(0, 1, 0);
constexpr double kDegree = 3.14159265358979323846 / 180;

bool isFinite(const glm::dvec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

// ---- ranges -------------------------------------------------------------------------------------

bool isRight(size_t joint) { return oppositeJoint(joint) < joint; }

// A rotation vector seen in a mirror across x.
glm::dvec3 mirror(const glm::dvec3& rotation) { return {rotation.x, -rotation.y, -rotation.z}; }

struct SwingTwist {
    double u = 0, v = 0, twist = 0;  // degrees
};

SwingTwist takeApart(const JointRange& range, const glm::dquat& q) {
    const glm::dvec3 imaginary(q.x, q.y, q.z);
    double s = glm::dot(imaginary, range.axis), c = q.w;
    if (c < 0) s = -s, c = -c;
    SwingTwist parts;
    // Without c and s the bone points backwards, and any twist fits.
    const double twist = std::hypot(c, s) > 1e-12 ? 2 * std::atan2(s, c) : 0.;
    const glm::dvec3 swing = axisAngleOf(q * quaternionOf(-twist * range.axis)) / kDegree;
    return {glm::dot(swing, range.u), glm::dot(swing, range.v), twist / kDegree};
}

glm::dquat putTogether(const JointRange& range, const SwingTwist& parts) {
    return quaternionOf(kDegree * (parts.u * range.u + parts.v * range.v)) *
           quaternionOf(kDegree * parts.twist * range.axis);
}

// Where a swing lies between the middle, 0, and the ellipse's rim, 1.
double radiusOf(const JointRange& range, const SwingTwist& parts) {
    return std::hypot(parts.u / (parts.u < 0 ? range.aboutU.low : range.aboutU.high),
                      parts.v / (parts.v < 0 ? range.aboutV.low : range.aboutV.high));
}

AngleRange widened(const AngleRange& range, double began) {
    return {std::min(range.low, began), std::max(range.high, began)};
}

double beyond(const AngleRange& range, double value) {
    return std::max(range.low - value, value - range.high);
}

// Right joints as left ones, and back.
glm::dquat asLeft(size_t joint, const glm::dquat& q) {
    return isRight(joint) ? glm::dquat(q.w, q.x, -q.y, -q.z) : q;
}

}  // namespace

// ---- skeleton and pose --------------------------------------------------------------------------

bool Skeleton::hangsOn(size_t joint, size_t root) const {
    auto at = static_cast<int>(joint);
    while (at > static_cast<int>(root)) at = parents[static_cast<size_t>(at)];
    return at == static_cast<int>(root);
}

Skeleton skeletonOf(const BodyModel& body, const Betas& betas) {
    const std::vector<double> joints =
        restJoints(body, std::vector<double>(betas.begin(), betas.end()));
    Skeleton skeleton;
    for (size_t j = 0; j < joint::kCount; ++j) {
        skeleton.parents[j] = j == 0 ? -1 : body.parents[j];
        skeleton.rest[j] = {joints[3 * j], joints[3 * j + 1], joints[3 * j + 2]};
    }
    return skeleton;
}

Pose poseOf(const Theta& theta, const Trans& trans) {
    Pose pose;
    for (size_t j = 0; j < joint::kCount; ++j)
        pose.rotation[j] = {theta[3 * j], theta[3 * j + 1], theta[3 * j + 2]};
    pose.trans = {trans[0], trans[1], trans[2]};
    return pose;
}

Theta thetaOf(const Pose& pose) {
    Theta theta;
    for (size_t j = 0; j < joint::kCount; ++j)
        for (int k = 0; k < 3; ++k)
            theta[3 * j + static_cast<size_t>(k)] = static_cast<float>(pose.rotation[j][k]);
    return theta;
}

Trans transOf(const Pose& pose) {
    return {static_cast<float>(pose.trans.x), static_cast<float>(pose.trans.y),
            static_cast<float>(pose.trans.z)};
}

bool isFinite(const Pose& pose) {
    return isFinite(pose.trans) &&
           std::all_of(pose.rotation.begin(), pose.rotation.end(),
                       [](const glm::dvec3& rotation) { return isFinite(rotation); });
}

PosedSkeleton forwardKinematics(const Skeleton& skeleton, const Pose& pose) {
    PosedSkeleton posed;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const glm::dmat3 local = glm::mat3_cast(quaternionOf(pose.rotation[j]));
        if (skeleton.parents[j] < 0) {
            posed.rotation[j] = local;
            posed.position[j] = skeleton.rest[j] + pose.trans;
            continue;
        }
        const auto parent = static_cast<size_t>(skeleton.parents[j]);
        posed.rotation[j] = posed.rotation[parent] * local;
        posed.position[j] = posed.position[parent] +
                            posed.rotation[parent] * (skeleton.rest[j] - skeleton.rest[parent]);
    }
    return posed;
}

// ---- editing ------------------------------------------------------------------------------------

Pose rotateJoint(const Skeleton& skeleton, const Pose& pose, size_t joint, const glm::dvec3& axis,
                 double angle) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    const double length = glm::length(axis);
    if (!std::isfinite(angle) || !std::isfinite(length) || length == 0) return pose;
    glm::dvec3 local = axis / length;
    if (skeleton.parents[joint] >= 0) {
        const auto parent = static_cast<size_t>(skeleton.parents[joint]);
        local = glm::transpose(forwardKinematics(skeleton, pose).rotation[parent]) * local;
    }
    Pose result = pose;
    // Remainders keep a ring turned many times exact.
    constexpr double kTurn = 360 * kDegree;
    result.rotation[joint] = axisAngleOf(quaternionOf(std::remainder(angle, kTurn) * local) *
                                         quaternionOf(pose.rotation[joint]));
    return result;
}

Pose resetJoint(const Pose& pose, size_t joint, const Pose& original) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    Pose result = pose;
    result.rotation[joint] = original.rotation[joint];
    if (joint == joint::kPelvis) result.trans = original.trans;
    return result;
}

Pose mirrored(const Pose& pose) {
    Pose result = pose;
    for (size_t j = 1; j < joint::kCount; ++j)
        result.rotation[oppositeJoint(j)] = mirror(pose.rotation[j]);
    // The plane's normal is the level part of the body's own x axis. With S the reflection across
    // x and T the one in the plane, the mirror image is turned by T R S.
    const glm::dquat root = quaternionOf(pose.rotation[0]);
    const glm::dvec3 side = root * kX;
    if (std::hypot(side.x, side.z) < .2) return result;
    const double heading = std::atan2(-side.z, side.x);
    // T = Y S Y⁻¹ with Y the turn by `heading` about y, and S Y⁻¹ S = Y: T R S = Y Y (S R S).
    result.rotation[0] =
        axisAngleOf(quaternionOf(2 * heading * kY) * quaternionOf(mirror(pose.rotation[0])));
    return result;
}

Pose mirroredAcross(const Skeleton& skeleton, const Pose& pose, const Pose& began, size_t joint) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    Pose result = pose;
    for (size_t j = joint; oppositeJoint(j) != j; j = static_cast<size_t>(skeleton.parents[j]))
        if (pose.rotation[j] != began.rotation[j])
            result.rotation[oppositeJoint(j)] = mirror(pose.rotation[j]);
    return result;
}

glm::dvec3 placeAcross(const Skeleton& skeleton, const PosedSkeleton& posed, size_t joint,
                       const glm::dvec3& place) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    size_t trunk = joint;
    while (oppositeJoint(trunk) != trunk) trunk = static_cast<size_t>(skeleton.parents[trunk]);
    const glm::dvec3 side = posed.rotation[trunk] * kX;
    return place - 2 * glm::dot(place - posed.position[trunk], side) * side;
}

Pose sideCopied(const Pose& pose, bool leftToRight) {
    Pose result = pose;
    for (size_t j = 1; j < joint::kCount; ++j)
        if (oppositeJoint(j) != j && isRight(j) != leftToRight)
            result.rotation[oppositeJoint(j)] = mirror(pose.rotation[j]);
    return result;
}

// ---- limbs --------------------------------------------------------------------------------------

const std::array<size_t, joint::kCount>& jointsByLimb() {
    static constexpr std::array<size_t, joint::kCount> kOrder{
        joint::kPelvis,        joint::kSpine1,     joint::kSpine2,     joint::kSpine3,
        joint::kNeck,          joint::kHead,       joint::kLeftCollar, joint::kLeftShoulder,
        joint::kLeftElbow,     joint::kLeftWrist,  joint::kLeftHand,   joint::kRightCollar,
        joint::kRightShoulder, joint::kRightElbow, joint::kRightWrist, joint::kRightHand,
        joint::kLeftHip,       joint::kLeftKnee,   joint::kLeftAnkle,  joint::kLeftFoot,
        joint::kRightHip,      joint::kRightKnee,  joint::kRightAnkle, joint::kRightFoot};
    return kOrder;
}

std::optional<Limb> limbOfTree(size_t joint) {
    const auto& order = jointsByLimb();
    const auto place = std::ranges::find(order, joint) - order.begin();
    return place < 6    ? std::nullopt
           : place < 11 ? std::optional(Limb::LeftArm)
           : place < 16 ? std::optional(Limb::RightArm)
           : place < 20 ? std::optional(Limb::LeftLeg)
                        : std::optional(Limb::RightLeg);
}

std::optional<Limb> limbOf(const Skeleton& skeleton, size_t joint) {
    constexpr std::array<size_t, kLimbs> kHighest{joint::kLeftShoulder, joint::kRightShoulder,
                                                  joint::kLeftKnee, joint::kRightKnee};
    for (size_t limb = 0; limb < kLimbs; ++limb)
        if (skeleton.hangsOn(joint, kHighest[limb])) return static_cast<Limb>(limb);
    return std::nullopt;
}

Pose pointBone(const Skeleton& skeleton, const Pose& pose, size_t joint, const glm::dvec3& goal) {
    CHECK(joint > 0 && joint < joint::kCount, "joint {} hangs on another one", joint);
    const auto parent = static_cast<size_t>(skeleton.parents[joint]);
    const PosedSkeleton posed = forwardKinematics(skeleton, pose);
    const glm::dvec3 bone = posed.position[joint] - posed.position[parent],
                     to = goal - posed.position[parent], axis = glm::cross(bone, to);
    return rotateJoint(skeleton, pose, parent, axis,
                       std::atan2(glm::length(axis), glm::dot(bone, to)));
}

// ---- limits -------------------------------------------------------------------------------------

glm::dquat clampJoint(size_t joint, const glm::dquat& rotation, const glm::dquat& began) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    if (joint == joint::kPelvis) return rotation;
    const JointRange& range = rangeOf(joint);
    const SwingTwist found = takeApart(range, asLeft(joint, rotation));
    const SwingTwist before = takeApart(range, asLeft(joint, began));
    const auto clampTo = [](const AngleRange& allowed, double value) {
        return std::clamp(value, allowed.low, allowed.high);
    };
    SwingTwist allowed = found;
    allowed.twist = clampTo(widened(range.twist, before.twist), found.twist);
    if (range.ball) {
        const double radius = radiusOf(range, found);
        const double rim = std::max(1., radiusOf(range, before));
        if (radius > rim) allowed.u *= rim / radius, allowed.v *= rim / radius;
    } else {
        allowed.u = clampTo(widened(range.aboutU, before.u), found.u);
        allowed.v = clampTo(widened(range.aboutV, before.v), found.v);
    }
    // What is inside stays as it is to the last bit.
    constexpr double kSame = 1e-9;
    if (std::abs(allowed.u - found.u) + std::abs(allowed.v - found.v) +
            std::abs(allowed.twist - found.twist) <
        kSame)
        return rotation;
    return asLeft(joint, putTogether(range, allowed));
}

std::array<double, 3> beyondLimits(size_t joint, const glm::dquat& rotation,
                                   const glm::dquat& began) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    constexpr double kNever = -180 * kDegree;
    if (joint == joint::kPelvis) return {kNever, kNever, kNever};
    const JointRange& range = rangeOf(joint);
    const SwingTwist found = takeApart(range, asLeft(joint, rotation));
    const SwingTwist before = takeApart(range, asLeft(joint, began));
    const double twist = kDegree * beyond(widened(range.twist, before.twist), found.twist);
    if (range.ball) {
        const double radius = radiusOf(range, found);
        const double rim = std::max(1., radiusOf(range, before));
        // Along the swing's own direction; near the middle that is far inside whatever it is.
        const double swing = std::hypot(found.u, found.v);
        return {twist, radius > 1e-3 ? kDegree * swing * (1 - rim / radius) : kNever, kNever};
    }
    return {twist, kDegree * beyond(widened(range.aboutU, before.u), found.u),
            kDegree * beyond(widened(range.aboutV, before.v), found.v)};
}

Pose clampToLimits(const Pose& pose, const Pose& began) {
    Pose result = pose;
    for (size_t j = 1; j < joint::kCount; ++j) {
        const glm::dquat found = quaternionOf(pose.rotation[j]);
        const glm::dquat allowed = clampJoint(j, found, quaternionOf(began.rotation[j]));
        if (allowed != found) result.rotation[j] = axisAngleOf(allowed);
    }
    return result;
}

Pose clampToLimits(const Pose& pose) { return clampToLimits(pose, Pose{}); }

bool isHinge(size_t joint) { return joint != joint::kPelvis && !rangeOf(joint).ball; }

Bend bendOf(size_t hinge, const glm::dquat& rotation) {
    CHECK(isHinge(hinge), "{} is an elbow or a knee", jointName(hinge));
    const JointRange& range = rangeOf(hinge);
    const bool right = isRight(hinge);
    const SwingTwist parts = takeApart(
        range, right ? glm::dquat(rotation.w, rotation.x, -rotation.y, -rotation.z) : rotation);
    return {parts.u * kDegree, parts.v * kDegree, right ? mirror(range.u) : range.u,
            right ? mirror(range.v) : range.v};
}

}  // namespace doppel
