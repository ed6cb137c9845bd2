// Feet that stay where they are put.
#pragma once

#include <span>
#include <vector>

#include "trainer/motion/retarget/contacts.h"
#include "trainer/motion/retarget/proportions.h"

namespace doppel {

// Moves the whole motion up or down, so that in half of the frames the soles are as high above the
// ground as the source's: feet and ankles are not as high as legs are long.
void standOnGround(const Proportions& source, std::span<const JointPose> sourcePoses,
                   std::span<const FootContacts> contacts, const Proportions& target,
                   std::vector<JointPose>& poses);

// Keeps the target's feet in the source's contacts, and above the ground always, by moving the root
// up and down and the legs by inverse kinematics; see retarget(). How many stays of heels and toes
// there were.
//
// given: somebody has said that these are contacts, so points stay where they are put, on the
// ground, even if the source's wander and rise.
size_t keepFeet(const Proportions& source, std::span<const JointPose> sourcePoses,
                std::span<const FootContacts> contacts, bool given, const Proportions& target,
                std::vector<JointPose>& poses, double fps);

}  // namespace doppel
