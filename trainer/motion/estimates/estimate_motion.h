// Other programs' poses as motions.
#pragma once

#include "trainer/motion/estimates/estimate.h"
#include "trainer/motion/motion.h"

namespace doppel {

// Of the person with most poses: in the world that the program follows people in, where it does, or
// else before a camera of a guessed angle. Pictures between two poses are filled along straight
// lines and shortest turns, so that the motion keeps its speed. InputError for more than a million
// pictures.
Motion motionFromEstimates(const Estimates& estimates);

}  // namespace doppel
