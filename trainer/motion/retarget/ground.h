// The ground that a motion's feet stand on.
#pragma once

#include <optional>
#include <vector>

#include "trainer/motion/motion.h"
#include "trainer/motion/retarget/proportions.h"

namespace doppel {

// From the world of a motion's poses (before the cameras' views) to a space whose y points up and
// whose ground is y = 0. Rotation first.
using GroundFrame = RigidMotion;

// The plane on which the feet of this body stand through the motion.
//
// Up is exact where the motion has a world with y or z up. Before a camera it lies between the
// camera's own up and that of the bodies where they stand upright, and as far as the feet have been
// somewhere, the plane through the places where they stood decides: a fit with both as priors. The
// plane's height is where most of the lowest points of slow feet are.
//
// Nothing where there is no such plane: half of those points are nowhere within 12 cm, as where
// somebody swims, climbs, or only the upper body was seen.
std::optional<GroundFrame> groundOf(const Motion& motion, const Proportions& body);

// A motion's poses on that ground, per frame, and back.
std::vector<JointPose> onGround(const Motion& motion, const Proportions& body,
                                const GroundFrame& ground);
void fromGround(const std::vector<JointPose>& poses, const Proportions& body,
                const GroundFrame& ground, Motion& motion);

}  // namespace doppel
