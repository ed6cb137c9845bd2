// A body's joints and its linear blend skinning on the host, for what is done once per pose: the
// meshes of exports, and space around a body.
#pragma once

#include <array>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "trainer/data/pose.h"

namespace doppel {

// Where joints stand and how they are turned, the pelvis being where it is at rest.
struct Placement {
    std::array<glm::dquat, joint::kCount> turn;
    std::array<glm::dvec3, joint::kCount> origin;
};

struct Rig {
    const BodyModel& body;
    std::array<glm::dvec3, joint::kCount> rest;  // m, of the shape

    Rig(const BodyModel& body, const Betas& betas);

    Placement place(const Theta& theta) const;

    // Skinning takes vertex v of the shaped body from x to turn x + move; a pose's translation
    // comes on top.
    struct Blend {
        glm::dmat3 turn{0};
        glm::dvec3 move{0};
    };
    Blend skin(const Placement& placed, size_t v) const;
};

// [V,3] Sums of the cross products of each vertex's faces: larger faces count for more. verts
// [V,3], faces [F,3].
std::vector<float> areaNormals(std::span<const float> verts, std::span<const int32_t> faces);

}  // namespace doppel
