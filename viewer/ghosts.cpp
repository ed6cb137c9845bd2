// Ghosts of the frames before and after: where a movement comes from and goes.
#include <algorithm>
#include <cmath>

#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr double kOpacity = .55;  // of the nearest; the next ones fade
constexpr std::array<double, 3> kBefore{1, .62, .45}, kAfter{.5, .72, 1};

}  // namespace

std::vector<Viewer::Ghost> Viewer::ghosts() const {
    std::vector<Ghost> found;
    const double now = std::floor(timeline_), last = static_cast<double>(frameCount() - 1);
    // What is nearest covers what is further away.
    for (int k = settings_.ghosts; k > 0; --k)
        for (int side : {-1, 1}) {
            const double time = now + side * k * settings_.ghostSpacing;
            if (time < 0 || time > last) continue;
            const double opacity = kOpacity * (settings_.ghosts + 1 - k) / settings_.ghosts;
            found.push_back({editor_->poseAt(time), side < 0 ? kBefore : kAfter, opacity});
        }
    return found;
}

void Viewer::drawGhosts(const std::vector<Ghost>& ghosts, const Pane& pane,
                        std::vector<uint32_t>& pixels) {
    if (ghosts.empty()) return;
    // The networks would take a while for each.
    constexpr MeshKind kMesh = MeshKind::Body;
    const ShadeOptions clay{.paint = kPaintClay};
    for (const Ghost& ghost : ghosts) {
        scene_->setPose(thetaOf(ghost.pose), transOf(ghost.pose), editor_->betas());
        const std::vector<uint32_t> drawn =
            scene_->draw(kMesh, cameraOf(pane), view(), clay, pixels);
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
    const Pose pose = editor_->pose();
    scene_->setPose(thetaOf(pose), transOf(pose), editor_->betas());
}

}  // namespace doppel
