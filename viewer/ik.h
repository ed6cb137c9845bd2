// Inverse kinematics: the pose in which joints stand where they are dragged to.
//
// Damped least squares (Wampler, 1986; Nakamura and Hanafusa, 1986) in Levenberg and Marquardt's
// form, on rotation vectors. Each joint resists being turned away from where the drag began, arms
// and legs little, the trunk much: of all poses that reach the target the one found is that which
// turns least, so it depends on where the target is and hardly on the way there, and the trunk
// leans only for what the limb cannot reach alone: until it is pulled harder than a limb pulls that
// still has way to go, it stays where it is to the last bit. What the resistance holds back is
// added to the target, and they resist less, until the target itself is met. Joints stay within
// human ranges (skeleton.h). A tenth of a millisecond for a target, about one with three pins.
#pragma once

#include <cstddef>
#include <glm/glm.hpp>
#include <span>

#include "viewer/skeleton.h"

namespace doppel {

struct IkTarget {
    size_t joint = 0;
    glm::dvec3 position{};  // metres, the pose's space
    double weight = 1;      // of its squared distance against those of other targets
    // Something that is held where it is (a foot on the ground): its joints move to keep it there,
    // it does not move them. It keeps its orientation too, within its joint's range.
    bool pinned = false;
    glm::dmat3 orientation{1};  // of a pin: G_j
};
// A pin that holds the joint as it is in `posed`.
IkTarget pinnedAt(const PosedSkeleton& posed, size_t joint);

struct IkOptions {
    // The pose in which the drag began; null: `start`. Limits and resistance count from there.
    const Pose* began = nullptr;
    // Joints stay within human ranges. Without, they turn as far as the target asks, elbows and
    // knees still about their one axis.
    bool limits = true;
    double tolerance = 1e-4;  // metres within which a target counts as reached
    int steps = 24;           // of each of the few rounds at most
};

// Which joints turn: those between the pelvis and a dragged joint. The pelvis moves where it is
// dragged itself, or a joint that hangs on nothing else (hips, the lowest of the spine), and gives
// way a little where a leg is pinned, for then the body stands on something. Everything else keeps
// its numbers to the last bit.
//
// `start` is the last frame's result, from which the search goes on. The same arguments give the
// same bits. Where a target, or a pose, is not finite: `start`.
Pose solveIk(const Skeleton& skeleton, const Pose& start, std::span<const IkTarget> targets,
             const IkOptions& options = {});

}  // namespace doppel
