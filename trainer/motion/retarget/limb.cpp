#include "trainer/motion/retarget/limb.h"

#include <algorithm>
#include <cmath>

namespace doppel {

using namespace joint;

Limb legOf(size_t side) {
    return {kLeftHip + side, kLeftKnee + side, kLeftAnkle + side, {1, 0, 0}};
}

Limb armOf(size_t side) {
    return {
        kLeftShoulder + side, kLeftElbow + side, kLeftWrist + side, {0, side == 0 ? -1. : 1., 0}};
}

double lengthOf(const Proportions& body, const Limb& limb) {
    return glm::distance(body.rest[limb.root], body.rest[limb.middle]) +
           glm::distance(body.rest[limb.middle], body.rest[limb.end]);
}

void reach(const Proportions& body, const Limb& limb, const glm::dvec3& goal, JointPose& pose) {
    const PlacedJoints joints = placed(body, pose);
    const glm::dvec3 root = joints.place[limb.root];
    const glm::dvec3 upper = joints.place[limb.middle] - root;
    const glm::dvec3 lower = joints.place[limb.end] - joints.place[limb.middle];
    const double a = glm::length(upper), b = glm::length(lower);
    const double wanted = glm::distance(goal, root);
    if (a < 1e-6 || b < 1e-6 || wanted < 1e-6) return;
    // Where the limb is bent, about that axis; towards straight it is the hinge's more and more. A
    // joint bent backwards a little, as estimates have them, is one bent the right way.
    const glm::dvec3 hinge = joints.turn[limb.root] * limb.hinge;
    glm::dvec3 axis = glm::cross(upper, lower) / (a * b);
    if (const double wrong = glm::dot(axis, hinge); wrong < 0) axis -= 2 * wrong * hinge;
    axis = glm::normalize(axis + .15 * hinge);
    // upper . R(angle) lower = (wanted^2 - a^2 - b^2) / 2, of which the part along the axis is
    // fixed.
    const glm::dvec3 fixed = glm::dot(lower, axis) * axis, across = lower - fixed;
    const double cosine = glm::dot(upper, across), sine = glm::dot(upper, glm::cross(axis, across));
    const double most = std::hypot(cosine, sine);
    double angle = 0;
    if (most > 1e-9) {
        const double rest = (wanted * wanted - a * a - b * b) / 2 - glm::dot(upper, fixed);
        angle = std::atan2(sine, cosine) + std::acos(std::clamp(rest / most, -1., 1.));
    }
    const glm::dquat bend = glm::angleAxis(angle, axis);
    const glm::dquat swing =
        turnBetween(glm::normalize(upper + bend * lower), glm::normalize(goal - root));
    const glm::dquat end = joints.turn[limb.end];
    const glm::dquat rootTurn = swing * joints.turn[limb.root];
    const glm::dquat middleTurn = swing * bend * joints.turn[limb.middle];
    const glm::dquat parent = joints.turn[body.parents[limb.root]];
    pose.local[limb.root] = glm::normalize(glm::conjugate(parent) * rootTurn);
    pose.local[limb.middle] = glm::normalize(glm::conjugate(rootTurn) * middleTurn);
    pose.local[limb.end] = glm::normalize(glm::conjugate(middleTurn) * end);
}

namespace {

template <typename Value>
std::vector<Value> gaussian(const std::vector<Value>& values, double deviation) {
    if (deviation < .2 || values.size() < 2) return values;
    const auto count = static_cast<int64_t>(values.size());
    const auto reach = static_cast<int64_t>(std::ceil(3 * deviation));
    std::vector<double> weights;
    for (int64_t k = 0; k <= reach; ++k)
        weights.push_back(std::exp(-.5 * double(k * k) / (deviation * deviation)));
    std::vector<Value> result(values.size());
    for (int64_t i = 0; i < count; ++i) {
        Value sum{};
        double total = 0;
        for (int64_t k = -reach; k <= reach; ++k) {
            int64_t from = i + k;
            if (from < 0) from = -from;
            if (from >= count) from = 2 * count - 2 - from;
            from = std::clamp<int64_t>(from, 0, count - 1);
            const double weight = weights[static_cast<size_t>(std::abs(k))];
            sum += weight * values[static_cast<size_t>(from)];
            total += weight;
        }
        result[static_cast<size_t>(i)] = sum / total;
    }
    return result;
}

}  // namespace

std::vector<double> smoothOverTime(const std::vector<double>& values, double deviation) {
    return gaussian(values, deviation);
}

std::vector<glm::dvec3> smoothOverTime(const std::vector<glm::dvec3>& values, double deviation) {
    return gaussian(values, deviation);
}

std::vector<double> smoothAbove(const std::vector<double>& values, double deviation) {
    const auto count = static_cast<int64_t>(values.size());
    // The mean's window is as wide as the largest's, so that nothing in it is lower than the value.
    const auto reach = deviation < .2 ? 0 : static_cast<int64_t>(std::ceil(3 * deviation));
    std::vector<double> largest = values;
    for (int64_t i = 0; i < count; ++i)
        for (int64_t k = std::max<int64_t>(0, i - reach); k <= std::min(count - 1, i + reach); ++k)
            largest[static_cast<size_t>(i)] =
                std::max(largest[static_cast<size_t>(i)], values[static_cast<size_t>(k)]);
    return gaussian(largest, deviation);
}

}  // namespace doppel
