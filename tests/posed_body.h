// Bodies and poses for the tests of skeleton and inverse kinematics.
#pragma once

#include <gtest/gtest.h>

#include <random>

#include "trainer/avatar/avatar.h"
#include "viewer/pose/balance.h"
#include "viewer/pose/ik.h"
#include "viewer/pose/skeleton.h"

namespace doppel::test {

inline constexpr double kDegree = 3.14159265358979323846 / 180;

inline const BodyModel& body() {
    static const BodyModel model = bodyFromNpz(readBodyArrays("default"));
    return model;
}
inline const Skeleton& skeleton() {
    static const Skeleton made = skeletonOf(body(), {});
    return made;
}

// The same numbers from every standard library.
inline double uniformIn(std::mt19937& random, double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.);
}
inline glm::dvec3 direction(std::mt19937& random) {
    while (true) {
        const glm::dvec3 v(uniformIn(random, -1, 1), uniformIn(random, -1, 1),
                           uniformIn(random, -1, 1));
        const double length = glm::length(v);
        if (length > .1 && length < 1) return v / length;
    }
}

// A pose that a human could take: every joint turned by up to `angle`, then put within its range.
inline Pose randomPose(std::mt19937& random, double angle) {
    Pose pose;
    for (glm::dvec3& rotation : pose.rotation)
        rotation = direction(random) * uniformIn(random, 0, angle);
    pose.trans = direction(random);
    return clampToLimits(pose);
}

// Arms lowered, elbows and knees a little bent: how people stand.
inline Pose standing() {
    Pose pose;
    pose.rotation[joint::kLeftShoulder] = {0, 0, -1.1};
    pose.rotation[joint::kRightShoulder] = {0, 0, 1.1};
    pose.rotation[joint::kLeftElbow] = {0, -.3, 0};
    pose.rotation[joint::kRightElbow] = {0, .3, 0};
    return pose;
}

inline glm::dvec3 placeOf(const Pose& pose, size_t joint) {
    return forwardKinematics(skeleton(), pose).position[joint];
}

// The angle between two poses' rotations of a joint.
inline double turnBetween(const Pose& a, const Pose& b, size_t joint) {
    return glm::length(axisAngleOf(quaternionOf(a.rotation[joint]) *
                                   glm::conjugate(quaternionOf(b.rotation[joint]))));
}
inline double largestTurn(const Pose& a, const Pose& b) {
    double largest = 0;
    for (size_t j = 0; j < joint::kCount; ++j) largest = std::max(largest, turnBetween(a, b, j));
    return largest;
}

inline void expectWithinLimits(const Pose& pose, const std::string& what) {
    const Pose clamped = clampToLimits(pose);
    for (size_t j = 0; j < joint::kCount; ++j)
        EXPECT_LT(turnBetween(pose, clamped, j), 1e-6) << what << ": " << jointName(j);
}

}  // namespace doppel::test
