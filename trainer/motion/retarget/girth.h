// Limbs that would go into a body that is thicker than the one that moved.
#pragma once

#include <span>
#include <vector>

#include "trainer/motion/retarget/proportions.h"

namespace doppel {

// How far the target's forearms and hands go into its trunk, head and thighs, and its legs into
// each other, beyond what the source's do in the same frame, metres: the largest of all pairs, 0
// for none. Measured with capsules, which overlap where limbs begin even at rest; the source's
// share tells that from a collision.
double excessDepth(const Proportions& source, const JointPose& sourcePose,
                   const Proportions& target, const JointPose& targetPose);

// Turns the thighs outwards where the legs go into each other, frame by frame as little as it
// takes, and the changes are smooth over time. The feet keep how they are turned.
void clearLegs(const Proportions& source, std::span<const JointPose> sourcePoses,
               const Proportions& target, std::vector<JointPose>& targetPoses, double fps);

// Turns shoulders and elbows where forearms or hands go into trunk, head or thighs; likewise.
void clearArms(const Proportions& source, std::span<const JointPose> sourcePoses,
               const Proportions& target, std::vector<JointPose>& targetPoses, double fps);

}  // namespace doppel
