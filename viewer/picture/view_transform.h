// From the world to a viewer's camera.
#pragma once

#include <glm/glm.hpp>

namespace doppel {

// World: the capture's camera space, so x right, y down, z away from its camera; metres. A view
// brings a point to camera space by rotation * point + translation and projects it with the camera.
struct ViewTransform {
    glm::dmat3 rotation{1};
    glm::dvec3 translation{0};

    glm::dvec3 operator()(const glm::dvec3& point) const { return rotation * point + translation; }
    bool operator==(const ViewTransform&) const = default;
};

}  // namespace doppel
