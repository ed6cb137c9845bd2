// The centre of mass, and what a body stands on.
#pragma once

#include <array>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "nn/body/human_joints.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

glm::dvec3 centreOfMass(const PosedSkeleton& posed);  // metres

// Seen from above: poses stand along the y axis in every space that they live in.
inline glm::dvec2 fromAbove(const glm::dvec3& p) { return {p.x, p.z}; }

// From the nearest point of what `corners` span to p; 0 where p is inside.
glm::dvec2 wayOut(const glm::dvec2& p, std::span<const glm::dvec2> corners);

// What the foot of this leg stands on, as seen from above: ankle and ball, the joints of SMPL that
// have a place there, moved by so much. joint: one of the leg, below the hip.
void addFoot(const PosedSkeleton& posed, size_t joint, const glm::dvec3& moved,
             std::vector<glm::dvec2>& corners);

// How far the centre of mass is outside of what these feet span, metres; 0 inside, and where there
// are none.
double outOfBalance(const PosedSkeleton& posed, std::span<const size_t> feet);

}  // namespace doppel
