// Translucent bodies of other frames, behind the avatar.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "viewer/picture/scene.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

// The body in a frame near the one that is shown.
struct Ghost {
    Pose pose;
    std::array<double, 3> tint{};
    double opacity = 0;
    bool operator==(const Ghost&) const = default;
};

// Onto pixels [H,W] of R, G, B, A, the first one furthest back. The scene has another pose then.
void drawGhosts(Scene& scene, std::span<const Ghost> ghosts, const Betas& betas,
                const Camera& camera, const ViewTransform& view, std::span<uint32_t> pixels);

}  // namespace doppel
