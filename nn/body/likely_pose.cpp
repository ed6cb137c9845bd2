#include "nn/body/likely_pose.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>

#include "nn/body/human_joints.h"

namespace doppel {

namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;

// Of left and middle joints, degrees; a right joint is the mirror image, (x, -y, -z).
struct Ease {
    size_t left, right;  // the same for a joint in the middle
    std::array<double, 3> mean, deviation;
};

constexpr std::array kEase{
    Ease{joint::kLeftHip, joint::kRightHip, {-3, 0, 2}, {10, 8, 6}},
    Ease{joint::kLeftKnee, joint::kRightKnee, {6, 0, 0}, {8, 5, 3}},
    Ease{joint::kLeftAnkle, joint::kRightAnkle, {0, 0, 0}, {10, 8, 8}},
    Ease{joint::kSpine1, joint::kSpine1, {2, 0, 0}, {5, 5, 4}},
    Ease{joint::kSpine2, joint::kSpine2, {0, 0, 0}, {5, 5, 4}},
    Ease{joint::kSpine3, joint::kSpine3, {0, 0, 0}, {5, 5, 4}},
    Ease{joint::kLeftCollar, joint::kRightCollar, {0, 0, 0}, {8, 8, 8}},
    Ease{joint::kLeftShoulder, joint::kRightShoulder, {5, 0, -65}, {20, 15, 30}},
    Ease{joint::kLeftElbow, joint::kRightElbow, {0, -15, 0}, {30, 20, 8}},
    Ease{joint::kLeftWrist, joint::kRightWrist, {0, 0, 0}, {20, 15, 15}},
};

}  // namespace

std::vector<LikelyAngle> likelyPose() {
    std::vector<LikelyAngle> pose(kThetaSize);
    for (const Ease& ease : kEase)
        for (const size_t joint : {ease.left, ease.right})
            for (size_t k = 0; k < 3; ++k) {
                const double side = joint != ease.left && k > 0 ? -1 : 1;
                pose[3 * joint + k].mean = float(side * ease.mean[k] * kDegree);
                pose[3 * joint + k].precision = float(1 / (ease.deviation[k] * kDegree));
            }
    for (size_t joint = 1; joint < joint::kCount; ++joint) {
        if (joint == joint::kLeftShoulder || joint == joint::kRightShoulder) continue;
        const JointRange& range = rangeOf(joint);
        const auto limit = [&](const glm::dvec3& axis, const AngleRange& angles) {
            for (int k = 0; k < 3; ++k) {
                if (std::abs(axis[k]) < .5) continue;
                const double side = k > 0 && oppositeJoint(joint) < joint ? -axis[k] : axis[k];
                LikelyAngle& angle = pose[3 * joint + size_t(k)];
                angle.low = float(std::min(side * angles.low, side * angles.high) * kDegree);
                angle.high = float(std::max(side * angles.low, side * angles.high) * kDegree);
            }
        };
        limit(range.axis, range.twist);
        limit(range.u, range.aboutU);
        limit(range.v, range.aboutV);
    }
    return pose;
}

}  // namespace doppel
