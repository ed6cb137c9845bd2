// A floor behind the avatar: a grid of half metres, and the body's contact shadow on it.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "trainer/avatar/films/contact_shadow.h"
#include "trainer/data/camera.h"
#include "trainer/data/pose.h"
#include "viewer/picture/scene.h"

namespace doppel {

// A camera's space -> the floor's, whose y points up and whose floor is y = 0.
using ToFloor = RigidMotion;

// The floor as contactShadow() has it.
Ground asGround(const ToFloor& toFloor);

// Onto pixels [H,W] of R, G, B, A. centre: x and z of the floor that the grid fades out around;
// line: its lines' width, pixels; shadow [H,W] as contactShadow() has it. Nothing where the camera
// is below the floor, for it would hide the body.
void paintFloor(std::span<uint32_t> picture, const Camera& camera, const ToFloor& toFloor,
                const glm::dvec2& centre, double line, std::span<const float> shadow);

// Who throws a shadow on it: vertices [V,3] in camera space, faces [F,3].
struct FloorBody {
    std::vector<float> verts;
    std::span<const int32_t> faces;
};
// Grid and shadows: from the poses' world `toFloor`; the grid is around `pelvis` there.
void drawFloor(std::span<uint32_t> picture, const Camera& camera, const ViewTransform& view,
               const RigidMotion& toFloor, const glm::dvec3& pelvis, double line,
               std::span<const FloorBody> bodies);

}  // namespace doppel
