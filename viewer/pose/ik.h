// Inverse kinematics: the pose in which joints stand where they are dragged to.
//
// Newton's method on rotation vectors, damped as Levenberg and Marquardt damp it (Wampler, 1986;
// Nakamura and Hanafusa, 1986). Each joint resists being turned away from where the drag began,
// arms and legs little, the trunk much: of all poses that reach the target the one found is that
// which turns least. It is found from where the drag began every time, the target being led to its
// place by centimetres, so that it depends on where the target is and neither on the way there nor
// on how fast the mouse was. The trunk leans only for what the limb cannot reach alone: until it is
// pulled harder than a limb pulls that still has way to go, it stays where it is to the last bit.
// Joints stay within human ranges (skeleton.h). Some milliseconds.
#pragma once

#include <cstddef>
#include <glm/glm.hpp>
#include <span>

#include "viewer/pose/ik_target.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

// A pin that holds the joint as it is in `posed`.
IkTarget pinnedAt(const PosedSkeleton& posed, size_t joint);

// Which joints turn: those between the pelvis and a dragged joint. The pelvis moves where it is
// dragged itself, or a joint that hangs on nothing else (hips, the lowest of the spine), and gives
// way a little where a leg is pinned, for then the body stands on something. Everything else keeps
// its numbers to the last bit.
//
// began: the pose in which the drag began; limits and resistance count from there. The same
// arguments give the same bits. Where a target, or the pose, is not finite: `began`.
Pose solveIk(const Skeleton& skeleton, const Pose& began, std::span<const IkTarget> targets,
             const IkOptions& options = {});

}  // namespace doppel
