#include "trainer/stages/caps/cells.h"

#include <algorithm>
#include <cmath>

namespace doppel {

namespace {

constexpr std::array<glm::ivec3, 3> kAxes = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

// A binomial mean over three cells along each axis.
std::vector<float> smoothed(const Cells& cells, std::vector<float> values) {
    for (const glm::ivec3& axis : kAxes) {
        const std::vector<float> before = values;
        for (size_t i = 0; i < values.size(); ++i) {
            const glm::ivec3 at = cells.place(i);
            auto value = [&](const glm::ivec3& other) {
                return cells.holds(other) ? before[cells.number(other)] : 0.f;
            };
            values[i] = .5f * before[i] + .25f * (value(at - axis) + value(at + axis));
        }
    }
    return values;
}

}  // namespace

Cells cellsAround(const std::vector<glm::dvec3>& points, double margin, double side) {
    glm::dvec3 low(INFINITY), high(-INFINITY);
    for (const glm::dvec3& p : points) low = glm::min(low, p), high = glm::max(high, p);
    Cells cells;
    cells.side = side;
    cells.corner = low - margin;
    cells.count = glm::ivec3(glm::ceil((high - low + 2 * margin) / side));
    return cells;
}

std::vector<int32_t> nearestPoints(const Cells& cells, const std::vector<glm::dvec3>& points,
                                   double reach) {
    std::vector<int32_t> nearest(cells.total(), -1);
    auto take = [&](size_t cell, int32_t point) {
        if (point < 0) return;
        const glm::dvec3 centre = cells.centre(cells.place(cell));
        const double distance = glm::distance(points[static_cast<size_t>(point)], centre);
        const int32_t own = nearest[cell];
        if (distance <= reach &&
            (own < 0 || distance < glm::distance(points[static_cast<size_t>(own)], centre)))
            nearest[cell] = point;
    };
    for (size_t p = 0; p < points.size(); ++p) {
        const glm::ivec3 at = cells.cellOf(points[p]);
        if (cells.holds(at)) take(cells.number(at), static_cast<int32_t>(p));
    }
    for (int round = 0; round < 2; ++round)
        for (const glm::ivec3& axis : kAxes)
            for (const bool back : {false, true})
                for (size_t k = 0; k < nearest.size(); ++k) {
                    const size_t i = back ? nearest.size() - 1 - k : k;
                    const glm::ivec3 from = cells.place(i) + (back ? axis : -axis);
                    if (cells.holds(from)) take(i, nearest[cells.number(from)]);
                }
    return nearest;
}

CellSurface surfaceAround(const Cells& cells, const std::vector<uint8_t>& inside) {
    std::vector<float> field(inside.size());
    std::ranges::transform(inside, field.begin(), [](uint8_t in) { return in ? 1.f : 0.f; });
    field = smoothed(cells, smoothed(cells, std::move(field)));
    // The half stands for zero.
    auto value = [&](const glm::ivec3& at) {
        return cells.holds(at) ? static_cast<double>(field[cells.number(at)]) - .5 : -.5;
    };
    // A vertex in each cube between eight centres whose values have both signs: the mean of where
    // its edges cross zero. The cube is named by its lowest centre.
    CellSurface surface;
    std::vector<int32_t> vertexOf(cells.total(), -1);
    for (size_t i = 0; i < cells.total(); ++i) {
        const glm::ivec3 at = cells.place(i);
        glm::dvec3 sum(0);
        int crossings = 0;
        for (int corner = 0; corner < 8; ++corner) {
            const glm::ivec3 a(corner & 1, corner >> 1 & 1, corner >> 2);
            for (const glm::ivec3& axis : kAxes) {
                const glm::ivec3 b = a + axis;
                if (b.x > 1 || b.y > 1 || b.z > 1) continue;
                const double va = value(at + a), vb = value(at + b);
                if ((va > 0) == (vb > 0)) continue;
                sum += glm::mix(glm::dvec3(a), glm::dvec3(b), va / (va - vb));
                ++crossings;
            }
        }
        if (crossings == 0) continue;
        vertexOf[i] = static_cast<int32_t>(surface.vertices.size());
        surface.vertices.push_back(cells.centre(at) + cells.side * sum / double(crossings));
    }
    // Around each edge between two centres of different signs, the four cubes that share it.
    for (size_t i = 0; i < cells.total(); ++i) {
        const glm::ivec3 at = cells.place(i);
        for (size_t k = 0; k < 3; ++k) {
            const double here = value(at), there = value(at + kAxes[k]);
            if ((here > 0) == (there > 0)) continue;
            const glm::ivec3 u = kAxes[(k + 1) % 3], v = kAxes[(k + 2) % 3];
            std::array<int32_t, 4> ring;
            bool whole = true;
            for (size_t n = 0; n < 4; ++n) {
                const glm::ivec3 cube =
                    at - (n == 0 || n == 3 ? u : glm::ivec3(0)) - (n < 2 ? v : glm::ivec3(0));
                ring[n] = cells.holds(cube) ? vertexOf[cells.number(cube)] : -1;
                whole &= ring[n] >= 0;
            }
            if (!whole) continue;
            if (here <= 0) std::swap(ring[1], ring[3]);
            // The shorter diagonal keeps faces from folding.
            auto length = [&](size_t a, size_t b) {
                return glm::distance(surface.vertices[static_cast<size_t>(ring[a])],
                                     surface.vertices[static_cast<size_t>(ring[b])]);
            };
            if (length(0, 2) <= length(1, 3)) {
                surface.faces.push_back({ring[0], ring[1], ring[2]});
                surface.faces.push_back({ring[0], ring[2], ring[3]});
            } else {
                surface.faces.push_back({ring[1], ring[2], ring[3]});
                surface.faces.push_back({ring[1], ring[3], ring[0]});
            }
        }
    }
    return surface;
}

}  // namespace doppel
