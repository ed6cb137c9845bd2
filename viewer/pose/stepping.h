// Feet that follow what is pulled further than a person reaches at ease.
#pragma once

#include <array>
#include <cstddef>
#include <glm/glm.hpp>
#include <span>

#include "viewer/pose/ik_target.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

// As solveIk(), with feet that step along the ground: so far that the first target is no further
// from between them, as seen from above, than a limb's length and a slight lean, or than it was.
// The foot that is ahead goes first, on its own side where neither is; once it stands a long step
// ahead, the other one comes after it. The body comes along. So the pose, too, depends on where the
// target is and not on the way there.
//
// targets: the first is dragged; pins of both ankles are among the others. ankles: of these pins,
// the left one first. up: a unit vector, away from the ground.
Pose solveWithSteps(const Skeleton& skeleton, const Pose& began, std::span<const IkTarget> targets,
                    const std::array<size_t, 2>& ankles, const glm::dvec3& up,
                    const IkOptions& options = {});

}  // namespace doppel
