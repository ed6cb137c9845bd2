// Smoother driving motions.
#pragma once

#include "trainer/motion/motion.h"

namespace doppel {

// Rotations and positions averaged over time with a Gaussian of so many frames' deviation, cut off
// at three. Rotations are averaged as rotations (the mean of unit quaternions on one side of the
// sphere), so that an axis-angle vector that jumps from one side of a full turn to the other is no
// jump. At the ends the window shrinks on both sides alike, so the first and the last pose stay.
// deviation 0: the motion as it is.
Motion smoothed(Motion motion, double deviation);

}  // namespace doppel
