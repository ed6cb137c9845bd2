// Points of a mesh's surface: which one a ray meets.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>

namespace doppel {

// It stays where it is on the surface while the mesh moves.
struct SurfacePoint {
    size_t face = 0;
    std::array<double, 3> corners{};  // barycentrics in the face
    bool operator==(const SurfacePoint&) const = default;
};

// Of vertices [V,3] and faces [F,3]: where the point is, and the face's normal, which has the
// length of twice its area and points to where its corners are seen counter-clockwise.
glm::dvec3 placeOf(const SurfacePoint& point, std::span<const float> verts,
                   std::span<const int32_t> faces);
glm::dvec3 normalOf(size_t face, std::span<const float> verts, std::span<const int32_t> faces);

struct SurfaceHit {
    SurfacePoint point;
    double distance;  // it is at origin + distance * direction
};

// The nearest point of the surface, from either side, that a ray meets in front of its origin.
std::optional<SurfaceHit> nearestHit(std::span<const float> verts, std::span<const int32_t> faces,
                                     const glm::dvec3& origin, const glm::dvec3& direction);

}  // namespace doppel
