#include "viewer/picture/ghosts.h"

#include <cmath>

namespace doppel {

void drawGhosts(Scene& scene, std::span<const Ghost> ghosts, const Betas& betas,
                const Camera& camera, const ViewTransform& view, std::span<uint32_t> pixels) {
    // The networks would take a while for each.
    constexpr MeshKind kMesh = MeshKind::Body;
    const ShadeOptions clay{.paint = kPaintClay};
    for (const Ghost& ghost : ghosts) {
        scene.setPose(thetaOf(ghost.pose), transOf(ghost.pose), betas);
        const std::vector<uint32_t> drawn = scene.draw(kMesh, camera, view, clay, pixels);
        for (size_t i = 0; i < pixels.size(); ++i) {
            if (drawn[i] == pixels[i]) continue;
            uint32_t word = pixels[i] & 0xff000000u;
            for (size_t c = 0; c < 3; ++c) {
                const double behind = pixels[i] >> 8 * c & 0xff;
                const double own = (drawn[i] >> 8 * c & 0xff) * ghost.tint[c];
                word |= static_cast<uint32_t>(std::lround(std::lerp(behind, own, ghost.opacity)))
                        << 8 * c;
            }
            pixels[i] = word;
        }
    }
}

}  // namespace doppel
