// What an avatar says of a point of its surface.
#pragma once

#include <glm/glm.hpp>
#include <optional>

#include "nn/body/joint.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/bake.h"
#include "viewer/inspect/surface_point.h"

namespace doppel {

struct Inspected {
    SurfacePoint point;
    size_t vertex = 0;   // the nearest of the face's
    BodyPart part{};     // the vertex's
    double bound = 0;    // K(v) of the vertex, metres (clampBounds)
    glm::dvec2 uv{};     // of the point, glTF's
    glm::ivec2 texel{};  // that holds it: column and row from the texture's top left corner
    // Where that texel's first colour came from; without: the avatar does not keep it.
    std::optional<TexelOrigin> origin;
};

// Nothing where the avatar's body has no such face.
std::optional<Inspected> inspect(const Avatar& avatar, const SurfacePoint& point);

// "left upper arm".
const char* partName(BodyPart part);

}  // namespace doppel
