#include "viewer/pose/skeleton.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;

bool isFinite(const glm::dvec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

// ---- ranges -------------------------------------------------------------------------------------

struct Range {
    double low, high;  // degrees
};

// A joint's rotation is taken apart into a twist about its bone's axis in the T-pose, and a swing
// of the bone about axes u and v across it (the swing's rotation vector in these two).
//
// Signs are those of SMPL's T-pose, of left and middle joints; the right side is its mirror image.
struct JointRange {
    glm::dvec3 axis, u, v;
    Range twist, aboutU, aboutV;
    // Ball joints: swings fill an ellipse, for nobody reaches the ends of both ranges at once.
    // Hinges: a box.
    bool ball;
};

constexpr glm::dvec3 kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);

// Ranges of motion of healthy adults as the American Academy of Orthopaedic Surgeons gives them
// (Greene and Heckman, "The Clinical Measurement of Joint Motion", 1994) and, for the spine, White
// and Panjabi, "Clinical Biomechanics of the Spine" (1990). Where SMPL has more joints than a
// physiotherapist measures (three in the trunk, two in the neck), they share a range. Captures put
// part of a forearm's rotation into the wrist and part of a shoulder girdle's into the shoulder,
// and active people go further than the mean: ranges are widened by up to a third for that.
const JointRange& rangeOf(size_t joint) {
    // Bending forward, and backward; to either side; turning. Thoracolumbar: 80, 25; 35; 45.
    static const JointRange spine1{kY, kX, kZ, {-14, 14}, {-15, 38}, {-16, 16}, true};
    static const JointRange spine2{kY, kX, kZ, {-18, 18}, {-14, 34}, {-16, 16}, true};
    static const JointRange spine3{kY, kX, kZ, {-24, 24}, {-12, 30}, {-16, 16}, true};
    // Cervical: 45 forward, 45 back; 45; 60 to 80.
    static const JointRange neck{kY, kX, kZ, {-42, 42}, {-32, 32}, {-26, 26}, true};
    static const JointRange head{kY, kX, kZ, {-42, 42}, {-32, 28}, {-24, 24}, true};
    // Hip: flexion 120 and extension 30 about −x, abduction 45 and adduction 30 about z, rotation
    // outward 45 and inward 45.
    static const JointRange hip{kY, -kX, kZ, {-45, 60}, {-35, 130}, {-35, 60}, true};
    // Knee: flexion 135 to 150, no extension beyond straight; some rotation when bent.
    static const JointRange knee{kY, kX, kZ, {-20, 20}, {0, 152}, {-6, 6}, false};
    // Ankle: plantar flexion 50, dorsiflexion 20 (40 under the body's weight), inversion 35,
    // eversion 15 to 20, and the foot's turning in and out.
    static const JointRange ankle{kZ, kX, kY, {-35, 20}, {-40, 52}, {-20, 25}, true};
    // Toes: bending up 70, down 40.
    static const JointRange foot{kZ, kX, kY, {-10, 10}, {-75, 42}, {-12, 12}, true};
    // Shoulder girdle: forward and back 15 to 20, up 30 to 40, down 10.
    static const JointRange collar{kX, -kY, kZ, {-20, 20}, {-22, 25}, {-14, 36}, true};
    // Shoulder, from the arm stretched sideways: horizontal adduction forward 135, abduction back
    // 45; up to the vertical (abduction 180), down to it and across the body (adduction 15);
    // rotation inward 70 to 90, outward 90.
    static const JointRange shoulder{kX, -kY, kZ, {-105, 95}, {-55, 142}, {-112, 102}, true};
    // Elbow: flexion 150, no extension beyond straight; pronation and supination 80 to 90.
    static const JointRange elbow{kX, -kY, kZ, {-90, 90}, {0, 152}, {-8, 8}, false};
    // Wrist, palm down: flexion 80, extension 70, to the thumb 20, to the little finger 30.
    static const JointRange wrist{kX, -kZ, -kY, {-45, 45}, {-75, 82}, {-36, 26}, true};
    // Knuckles: flexion 90, extension 30 to 45.
    static const JointRange hand{kX, -kZ, -kY, {-12, 12}, {-40, 92}, {-20, 20}, true};
    static const std::array<const JointRange*, joint::kCount> ranges = {
        nullptr,   &hip,      &hip,   &spine1, &knee,  &knee,   &spine2, &ankle,
        &ankle,    &spine3,   &foot,  &foot,   &neck,  &collar, &collar, &head,
        &shoulder, &shoulder, &elbow, &elbow,  &wrist, &wrist,  &hand,   &hand};
    return *ranges[joint];
}

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

Range widened(const Range& range, double began) {
    return {std::min(range.low, began), std::max(range.high, began)};
}

double beyond(const Range& range, double value) {
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
    const auto clampTo = [](const Range& allowed, double value) {
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
