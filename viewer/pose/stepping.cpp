#include "viewer/pose/stepping.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/error.h"
#include "viewer/pose/ik.h"

namespace doppel {

namespace {

constexpr double kLean = .12;      // metres that the body leans before a foot steps
constexpr double kTie = .03;       // metres: which foot is ahead is no question of less
constexpr double kLongStep = .75;  // between the ankles, parts of a leg's length

// Of the bones from one joint to the other, which hangs on it.
double lengthBetween(const Skeleton& skeleton, size_t from, size_t to) {
    double length = 0;
    for (size_t j = to; j != from; j = static_cast<size_t>(skeleton.parents[j]))
        length += glm::distance(skeleton.rest[j],
                                skeleton.rest[static_cast<size_t>(skeleton.parents[j])]);
    return length;
}

// How far the joint reaches along the ground with straight legs and trunk: an arm's length, less
// where it goes up as well; nothing where it is of the trunk or the head.
double reachOf(const Skeleton& skeleton, const PosedSkeleton& posed, const IkTarget& target,
               const glm::dvec3& up) {
    for (size_t shoulder : {joint::kLeftShoulder, joint::kRightShoulder}) {
        if (!skeleton.hangsOn(target.joint, shoulder)) continue;
        const double arm = lengthBetween(skeleton, shoulder, target.joint);
        const double rise = std::max(0., glm::dot(target.position - posed.position[shoulder], up));
        return std::sqrt(std::max(0., arm * arm - rise * rise));
    }
    return 0;
}

}  // namespace

Pose solveWithSteps(const Skeleton& skeleton, const Pose& began, std::span<const IkTarget> targets,
                    const std::array<size_t, 2>& ankles, const glm::dvec3& up,
                    const IkOptions& options) {
    CHECK(!targets.empty(), "something is dragged");
    std::vector<IkTarget> moved(targets.begin(), targets.end());
    std::array<IkTarget*, 2> feet{};
    for (IkTarget& target : moved)
        for (size_t i = 0; i < 2; ++i)
            if (target.joint == ankles[i] && target.pinned) feet[i] = &target;
    CHECK(feet[0] && feet[1], "both feet are pinned");
    const glm::dvec3 left = feet[0]->position, right = feet[1]->position;

    const IkTarget& pulled = targets[0];
    const PosedSkeleton posed = forwardKinematics(skeleton, began);
    const auto fromFeet = [&](const glm::dvec3& place) {
        const glm::dvec3 way = place - (left + right) / 2.;
        return way - glm::dot(way, up) * up;
    };
    const glm::dvec3 way = fromFeet(pulled.position);
    const double away = glm::length(way);
    const double atEase = std::max(reachOf(skeleton, posed, pulled, up) + kLean,
                                   glm::length(fromFeet(posed.position[pulled.joint])));
    if (!(away > atEase) || !std::isfinite(away)) return solveIk(skeleton, began, moved, options);

    const glm::dvec3 ahead = way / away;
    const double body = away - atEase, lead = glm::dot(left - right, ahead);
    bool leftFirst = lead > 0;
    if (std::abs(lead) < kTie) {
        const glm::dvec3& joint = posed.position[pulled.joint];
        leftFirst = glm::distance(joint, left) < glm::distance(joint, right);
    }
    const double leg = lengthBetween(skeleton, joint::kLeftHip, joint::kLeftAnkle);
    const double room = std::max(0., kLongStep * leg - (leftFirst ? lead : -lead));
    // The body is between its feet: one of them goes twice as far, and then both as far as it.
    const double first = std::min(2 * body, body + room / 2), second = 2 * body - first;
    feet[leftFirst ? 0 : 1]->position += first * ahead;
    feet[leftFirst ? 1 : 0]->position += second * ahead;
    Pose from = began;
    from.trans += body * ahead;
    return solveIk(skeleton, from, moved, options);
}

}  // namespace doppel
