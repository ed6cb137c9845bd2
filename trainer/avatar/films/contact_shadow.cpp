#include "trainer/avatar/films/contact_shadow.h"

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <numbers>
#include <numeric>

namespace doppel {

namespace {

constexpr size_t kWindow = 25;     // poses before and after that say where the ground is
constexpr double kLow = .3;        // of their lowest points, sorted: this one is on the ground
constexpr double kCell = .025;     // metres
constexpr int kCells = 128;        // along a side of the part of the ground that is looked at
constexpr double kStrength = .85;  // light comes from walls, too
constexpr float kFade = .7f;       // of the way to that part's edge: from here on it fades

glm::dvec3 vertex(std::span<const float> verts, size_t v) {
    return {verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]};
}

// join(begin, end) of the values at [i - kWindow, i + kWindow], as far as they exist, for each i.
template <typename T, typename Join>
std::vector<T> overWindow(const std::vector<T>& values, Join join) {
    std::vector<T> result;
    for (size_t i = 0; i < values.size(); ++i) {
        const size_t begin = i > kWindow ? i - kWindow : 0;
        const size_t end = std::min(i + kWindow + 1, values.size());
        result.push_back(join(std::span(values).subspan(begin, end - begin)));
    }
    return result;
}

// Where the ground is looked at: a square about the point below the body.
struct Patch {
    glm::dvec3 corner, across, along;  // metres; the two have length 1

    glm::dvec2 cellOf(const glm::dvec3& point) const {
        return {glm::dot(point - corner, across) / kCell, glm::dot(point - corner, along) / kCell};
    }
};

// How high above each cell the body begins, metres; infinity where it does not stand above it.
std::vector<float> heightsOf(std::span<const float> verts, std::span<const int32_t> faces,
                             const Ground& ground, const Patch& patch) {
    const glm::dvec3 up(ground.up[0], ground.up[1], ground.up[2]);
    std::vector<float> heights(size_t{kCells} * kCells, INFINITY);
    std::vector<glm::dvec3> places;  // cell across, cell along, height
    for (size_t v = 0; v < verts.size() / 3; ++v) {
        const glm::dvec3 point = vertex(verts, v);
        const glm::dvec2 cell = patch.cellOf(point);
        places.push_back({cell.x, cell.y, glm::dot(up, point) - ground.level});
    }
    for (size_t f = 0; f + 2 < faces.size(); f += 3) {
        const glm::dvec3& a = places[static_cast<size_t>(faces[f])];
        const glm::dvec3 ab = places[static_cast<size_t>(faces[f + 1])] - a;
        const glm::dvec3 ac = places[static_cast<size_t>(faces[f + 2])] - a;
        const double area = ab.x * ac.y - ab.y * ac.x;
        if (!(std::abs(area) > 1e-9)) continue;  // it stands upright
        // Cells whose middles lie below it.
        const auto cell = [](double place) {
            return static_cast<int>(std::clamp(place, 0., double{kCells - 1}));
        };
        const int left = cell(a.x + std::min({0., ab.x, ac.x}));
        const int right = cell(a.x + std::max({0., ab.x, ac.x}));
        const int front = cell(a.y + std::min({0., ab.y, ac.y}));
        const int back = cell(a.y + std::max({0., ab.y, ac.y}));
        for (int y = front; y <= back; ++y)
            for (int x = left; x <= right; ++x) {
                const double dx = x + .5 - a.x, dy = y + .5 - a.y;
                const double u = (dx * ac.y - dy * ac.x) / area;
                const double v = (ab.x * dy - ab.y * dx) / area;
                if (u < 0 || v < 0 || u + v > 1) continue;
                float& height = heights[static_cast<size_t>(y * kCells + x)];
                const double above = std::max(a.z + u * ab.z + v * ac.z, 0.);
                height = std::min(height, static_cast<float>(above));
            }
    }
    return heights;
}

// The part of the sky's light that each cell does not get. A level patch of area a at height h
// keeps a h² / (π (h² + r²)²) of it from a point at distance r from the one below it.
std::vector<float> occlusionOf(const std::vector<float>& heights) {
    constexpr auto kArea = static_cast<float>(kCell * kCell / std::numbers::pi);
    std::vector<float> occlusion(heights.size());
    for (int y = 0; y < kCells; ++y)
        for (int x = 0; x < kCells; ++x) {
            const float height = heights[static_cast<size_t>(y * kCells + x)];
            if (!(height < INFINITY)) continue;
            // Lower than a cell is wide, the sum over cells would not be the integral.
            const float h = std::max(height, static_cast<float>(kCell));
            const float weight = kArea * h * h;
            for (int v = 0; v < kCells; ++v) {
                const auto dy = static_cast<float>((v - y) * kCell);
                float* row = &occlusion[static_cast<size_t>(v) * kCells];
                for (int u = 0; u < kCells; ++u) {
                    const auto dx = static_cast<float>(u - x) * static_cast<float>(kCell);
                    const float square = h * h + dy * dy + dx * dx;
                    row[u] += weight / (square * square);
                }
            }
        }
    return occlusion;
}

}  // namespace

std::vector<Ground> groundsOf(BodyPoser& poser, std::span<const Theta> theta,
                              std::span<const Trans> trans, const Betas& betas) {
    std::vector<glm::dvec3> leans;
    for (size_t i = 0; i < theta.size(); ++i) {
        const PosedMesh posed = poser.pose(theta[i], trans[i], betas);
        glm::dvec3 middle(0), feet(0);
        for (size_t v = 0; v < posed.verts.size() / 3; ++v) middle += vertex(posed.verts, v);
        middle /= static_cast<double>(posed.verts.size() / 3);
        for (size_t joint : {7, 8, 10, 11})  // ankles and balls of the feet
            for (int k = 0; k < 3; ++k) feet[k] += posed.joints[joint][static_cast<size_t>(k)] / 4;
        leans.push_back(middle - feet);
    }
    leans = overWindow(leans, [](std::span<const glm::dvec3> some) {
        return std::accumulate(some.begin(), some.end(), glm::dvec3(0));
    });
    std::vector<double> lows;
    for (size_t i = 0; i < theta.size(); ++i) {
        leans[i] = glm::length(leans[i]) > 1e-6 ? glm::normalize(leans[i]) : glm::dvec3(0, -1, 0);
        const PosedMesh posed = poser.pose(theta[i], trans[i], betas);
        double low = INFINITY;
        for (size_t v = 0; v < posed.verts.size() / 3; ++v)
            low = std::min(low, glm::dot(leans[i], vertex(posed.verts, v)));
        lows.push_back(low);
    }
    const std::vector<double> levels = overWindow(lows, [](std::span<const double> some) {
        std::vector<double> sorted(some.begin(), some.end());
        std::ranges::sort(sorted);
        return sorted[static_cast<size_t>(kLow * double(sorted.size() - 1))];
    });
    // Smoothed, so that the ground does not step.
    const std::vector<double> smooth = overWindow(levels, [](std::span<const double> some) {
        return std::accumulate(some.begin(), some.end(), 0.) / double(some.size());
    });
    std::vector<Ground> grounds;
    for (size_t i = 0; i < lows.size(); ++i)
        grounds.push_back({{leans[i].x, leans[i].y, leans[i].z}, smooth[i]});
    return grounds;
}

std::vector<float> contactShadow(std::span<const float> verts, std::span<const int32_t> faces,
                                 const Ground& ground, const Camera& camera) {
    std::vector<float> shadow(static_cast<size_t>(camera.width) *
                              static_cast<size_t>(camera.height));
    if (ground.level >= 0) return shadow;  // the camera is below it
    const glm::dvec3 up(ground.up[0], ground.up[1], ground.up[2]);
    glm::dvec3 middle(0);
    for (size_t v = 0; v < verts.size() / 3; ++v) middle += vertex(verts, v);
    middle /= static_cast<double>(std::max<size_t>(verts.size() / 3, 1));
    middle -= (glm::dot(up, middle) - ground.level) * up;
    Patch patch;
    patch.across = glm::normalize(
        glm::cross(up, std::abs(up.x) < .7 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 0, 1)));
    patch.along = glm::cross(up, patch.across);
    patch.corner = middle - (patch.across + patch.along) * (kCells / 2 * kCell);
    const std::vector<float> occlusion = occlusionOf(heightsOf(verts, faces, ground, patch));

    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            const glm::dvec3 ray((x + .5 - camera.cx) / camera.fx, (y + .5 - camera.cy) / camera.fy,
                                 1);
            const double falling = glm::dot(up, ray);
            if (falling >= -1e-6) continue;
            const glm::dvec2 cell = patch.cellOf(ray * (ground.level / falling)) - .5;
            if (!(cell.x >= 0 && cell.y >= 0 && cell.x < kCells - 1 && cell.y < kCells - 1))
                continue;
            const auto u = static_cast<size_t>(cell.x), v = static_cast<size_t>(cell.y);
            const auto a = static_cast<float>(cell.x - double(u)),
                       b = static_cast<float>(cell.y - double(v));
            const float* at = &occlusion[v * kCells + u];
            float lost = (1 - b) * ((1 - a) * at[0] + a * at[1]) +
                         b * ((1 - a) * at[kCells] + a * at[kCells + 1]);
            const auto radius = static_cast<float>(glm::length(cell - glm::dvec2(kCells / 2.)));
            const float out = std::clamp((radius / (kCells / 2) - kFade) / (1 - kFade), 0.f, 1.f);
            lost = std::min(lost, 1.f) * float(kStrength) * (1 - out * out * (3 - 2 * out));
            shadow[static_cast<size_t>(y) * static_cast<size_t>(camera.width) +
                   static_cast<size_t>(x)] = 1 - std::pow(1 - lost, 1 / 2.2f);
        }
    return shadow;
}

}  // namespace doppel
