#include "viewer/inspect/surface_point.h"

#include <cmath>

namespace doppel {

namespace {

glm::dvec3 corner(size_t face, size_t k, std::span<const float> verts,
                  std::span<const int32_t> faces) {
    const auto v = static_cast<size_t>(faces[3 * face + k]);
    return {verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]};
}

}  // namespace

glm::dvec3 placeOf(const SurfacePoint& point, std::span<const float> verts,
                   std::span<const int32_t> faces) {
    glm::dvec3 place(0);
    for (size_t k = 0; k < 3; ++k) place += point.corners[k] * corner(point.face, k, verts, faces);
    return place;
}

glm::dvec3 normalOf(size_t face, std::span<const float> verts, std::span<const int32_t> faces) {
    const glm::dvec3 a = corner(face, 0, verts, faces);
    return glm::cross(corner(face, 1, verts, faces) - a, corner(face, 2, verts, faces) - a);
}

// Möller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997.
std::optional<SurfaceHit> nearestHit(std::span<const float> verts, std::span<const int32_t> faces,
                                     const glm::dvec3& origin, const glm::dvec3& direction) {
    constexpr double kEdge = 1e-9;  // or a ray would slip through between two faces
    std::optional<SurfaceHit> nearest;
    for (size_t face = 0; 3 * face + 2 < faces.size(); ++face) {
        const glm::dvec3 a = corner(face, 0, verts, faces);
        const glm::dvec3 ab = corner(face, 1, verts, faces) - a;
        const glm::dvec3 ac = corner(face, 2, verts, faces) - a;
        const glm::dvec3 p = glm::cross(direction, ac), from = origin - a;
        const double volume = glm::dot(ab, p);
        if (std::abs(volume) < 1e-18) continue;  // the ray runs in the face's plane
        const double u = glm::dot(from, p) / volume;
        const glm::dvec3 q = glm::cross(from, ab);
        const double v = glm::dot(direction, q) / volume, distance = glm::dot(ac, q) / volume;
        if (u < -kEdge || v < -kEdge || u + v > 1 + kEdge || distance <= 0) continue;
        if (nearest && nearest->distance <= distance) continue;
        nearest = SurfaceHit{{face, {1 - u - v, u, v}}, distance};
    }
    return nearest;
}

}  // namespace doppel
