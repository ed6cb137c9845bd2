// What inverse kinematics is asked for.
#pragma once

#include <cstddef>
#include <glm/glm.hpp>

namespace doppel {

struct IkTarget {
    size_t joint = 0;
    glm::dvec3 position{};  // metres, the pose's space
    double weight = 1;      // of its squared distance against those of other targets
    // Something that is held (a foot on the ground): its joints move to keep it there, it does not
    // move them. It keeps its orientation too, within its joint's range.
    bool pinned = false;
    glm::dmat3 orientation{1};  // of a pin: G_j
};

struct IkOptions {
    // Joints stay within human ranges. Without, they turn as far as the target asks, elbows and
    // knees still about their one axis.
    bool limits = true;
    // Where a foot is pinned and something else than the body itself is dragged, the centre of mass
    // stays over the pinned feet, or goes no further from them than it was.
    bool balance = true;
};

}  // namespace doppel
