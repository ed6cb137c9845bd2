#include "viewer/picture/bounds.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace doppel {

void Bounds::add(const float* vertex, const Camera& camera, const ViewTransform& view) {
    glm::dvec3 p = view({vertex[0], vertex[1], vertex[2]});
    if (p.z < 1e-3) {
        left = top = -INFINITY;
        right = bottom = INFINITY;
        return;
    }
    double u = camera.fx * p.x / p.z + camera.cx, v = camera.fy * p.y / p.z + camera.cy;
    left = std::min(left, u), right = std::max(right, u);
    top = std::min(top, v), bottom = std::max(bottom, v);
}

Bounds boundsOf(std::span<const float> verts, const Camera& camera, const ViewTransform& view) {
    Bounds bounds;
    for (size_t i = 0; i < verts.size(); i += 3) bounds.add(&verts[i], camera, view);
    return bounds;
}

Bounds boundsOfMoved(std::span<const float> before, std::span<const float> now,
                     std::span<const int32_t> faces, int rings, const Camera& camera,
                     const ViewTransform& view) {
    std::vector<uint8_t> touched(now.size() / 3);
    for (size_t v = 0; v < touched.size(); ++v)
        touched[v] = !std::equal(&now[3 * v], &now[3 * v] + 3, &before[3 * v]);
    for (int ring = 0; ring < rings; ++ring) {
        std::vector<uint8_t> inner = touched;
        for (size_t i = 0; i + 2 < faces.size(); i += 3) {
            auto a = static_cast<size_t>(faces[i]), b = static_cast<size_t>(faces[i + 1]);
            auto c = static_cast<size_t>(faces[i + 2]);
            if (inner[a] | inner[b] | inner[c]) touched[a] = touched[b] = touched[c] = 1;
        }
    }
    Bounds bounds;
    for (size_t v = 0; v < touched.size(); ++v) {
        if (!touched[v]) continue;
        bounds.add(&before[3 * v], camera, view);
        bounds.add(&now[3 * v], camera, view);
    }
    return bounds;
}

PixelBox around(const Bounds& bounds, const Camera& camera) {
    constexpr int kGrid = 64;
    auto range = [](double low, double high, int size) {
        int begin =
            std::clamp(static_cast<int>(std::floor(std::clamp(low, -1e6, 1e6))) - 1, 0, size);
        int end =
            std::clamp(static_cast<int>(std::ceil(std::clamp(high, -1e6, 1e6))) + 1, begin, size);
        begin = begin / (kGrid / 2) * (kGrid / 2);
        end = std::min(begin + (end - begin + kGrid - 1) / kGrid * kGrid, size);
        return std::pair{begin, end - begin};
    };
    if (bounds.left > bounds.right) return {};
    auto [x, width] = range(bounds.left, bounds.right, camera.width);
    auto [y, height] = range(bounds.top, bounds.bottom, camera.height);
    return {x, y, width, height};
}

}  // namespace doppel
