// Ghosts of the frames before and after: where a movement comes from and goes.
#include <algorithm>
#include <cmath>

#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr double kOpacity = .55;  // of the nearest; the next ones fade
constexpr std::array<double, 3> kBefore{1, .62, .45}, kAfter{.5, .72, 1};

}  // namespace

std::vector<Ghost> Viewer::ghosts(double time) const {
    std::vector<Ghost> found;
    const double now = std::floor(time), last = static_cast<double>(frameCount() - 1);
    // What is nearest covers what is further away.
    for (int k = settings_.ghosts; k > 0; --k)
        for (int side : {-1, 1}) {
            const double then = now + side * k * settings_.ghostSpacing;
            if (then < 0 || then > last) continue;
            const double opacity = kOpacity * (settings_.ghosts + 1 - k) / settings_.ghosts;
            found.push_back({editor_->poseAt(then), side < 0 ? kBefore : kAfter, opacity});
        }
    return found;
}

}  // namespace doppel
