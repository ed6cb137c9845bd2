// Limbs of two bones, and the smoothing of what is changed over time.
#pragma once

#include <functional>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <vector>

#include "trainer/motion/retarget/proportions.h"

namespace doppel {

// A leg or an arm.
struct Limb {
    size_t root = 0, middle = 0, end = 0;  // hip, knee, ankle; shoulder, elbow, wrist
    glm::dvec3 hinge{0};  // the axis about which the middle joint bends, in the root joint's frame
};
Limb legOf(size_t side);  // 0 left, 1 right
Limb armOf(size_t side);

// Lengths of both bones together, metres.
double lengthOf(const Proportions& body, const Limb& limb);

// Turns root and middle so that the end comes to `goal`, in closed form: the middle joint bends
// about the axis about which it is bent already (its hinge where it is straight), then the limb
// turns the shortest way. The end's own orientation in space stays. A goal out of reach is gone
// towards. Both bones keep their lengths.
void reach(const Proportions& body, const Limb& limb, const glm::dvec3& goal, JointPose& pose);

// A Gaussian mean over time with this deviation in frames, whose window reflects at the ends.
std::vector<double> smoothOverTime(const std::vector<double>& values, double deviation);
std::vector<glm::dvec3> smoothOverTime(const std::vector<glm::dvec3>& values, double deviation);
// A smooth curve that is nowhere below the values: the largest nearby, then the mean.
std::vector<double> smoothAbove(const std::vector<double>& values, double deviation);

}  // namespace doppel
