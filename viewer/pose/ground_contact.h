// What of a body stands on a floor, and what is below it.
#pragma once

#include <vector>

#include "trainer/motion/retarget/proportions.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

// toFloor: from the pose's space to one whose y points up and whose floor is y = 0. Metres.

// The ankles of the feet whose soles are within 25 mm of the floor.
std::vector<size_t> standingAnkles(const Proportions& body, const PosedSkeleton& posed,
                                   const RigidMotion& toFloor);
// How high the body's lowest point is: soles, and the rest as the capsules of `body` have it.
double lowestPoint(const Proportions& body, const PosedSkeleton& posed, const RigidMotion& toFloor);

}  // namespace doppel
