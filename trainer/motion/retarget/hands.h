// Where hands go on a body of other proportions.
#pragma once

#include <span>
#include <vector>

#include "trainer/motion/retarget/proportions.h"

namespace doppel {

// Arms that are turned as the source's are bring hands elsewhere on a body whose arms are longer or
// whose trunk is wider: hands that met pass each other, and the one on the hip is beside it or in
// it. As far as a hand of the source touches the other one, or its trunk, head or thighs, it goes
// to the same place of the target's, as far off its surface: fully within 3 cm, and less and less
// up to 10. Hands that touch nothing stay where the rotations take them.
void touchAsTheSource(const Proportions& source, std::span<const JointPose> sourcePoses,
                      const Proportions& target, std::vector<JointPose>& poses, double fps);

// The knuckles go as high above the ground, and as far from the root across it, as the source's:
// times `size`, which is how many of the world's metres are in one of the motion's.
void reachInSpace(const Proportions& source, std::span<const JointPose> sourcePoses, double size,
                  const Proportions& target, std::vector<JointPose>& poses);

// Metres from where a hand that touches should be, beside what it touches: the mean of the frame's
// touches; negative where there are none.
double touchError(const Proportions& source, const JointPose& sourcePose, const Proportions& target,
                  const JointPose& targetPose);

}  // namespace doppel
