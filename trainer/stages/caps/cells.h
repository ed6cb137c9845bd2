// A box of space in cubic cells, and the surface around some of them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

namespace doppel {

struct Cells {
    glm::ivec3 count{0};
    glm::dvec3 corner{0};  // the lowest, m
    double side = 0;       // m

    size_t total() const {
        return static_cast<size_t>(count.x) * static_cast<size_t>(count.y) *
               static_cast<size_t>(count.z);
    }
    bool holds(const glm::ivec3& at) const {
        return at.x >= 0 && at.y >= 0 && at.z >= 0 && at.x < count.x && at.y < count.y &&
               at.z < count.z;
    }
    size_t number(const glm::ivec3& at) const {
        return (static_cast<size_t>(at.z) * static_cast<size_t>(count.y) +
                static_cast<size_t>(at.y)) *
                   static_cast<size_t>(count.x) +
               static_cast<size_t>(at.x);
    }
    glm::ivec3 place(size_t number) const {
        const auto x = static_cast<size_t>(count.x), y = static_cast<size_t>(count.y);
        return {static_cast<int>(number % x), static_cast<int>(number / x % y),
                static_cast<int>(number / (x * y))};
    }
    glm::dvec3 centre(const glm::ivec3& at) const { return corner + side * (glm::dvec3(at) + .5); }
    glm::ivec3 cellOf(const glm::dvec3& p) const {
        return glm::ivec3(glm::floor((p - corner) / side));
    }
};

// Cells around points, `margin` (m) beyond them on all sides. side: m.
Cells cellsAround(const std::vector<glm::dvec3>& points, double margin, double side);

// For each cell the point nearest to its centre, of those that a sweep over neighbours finds:
// hardly ever another than the nearest of all (Danielsson, Euclidean Distance Mapping, 1980). -1
// beyond `reach`.
std::vector<int32_t> nearestPoints(const Cells& cells, const std::vector<glm::dvec3>& points,
                                   double reach);

struct CellSurface {
    std::vector<glm::dvec3> vertices;
    std::vector<std::array<int32_t, 3>> faces;  // counter-clockwise from outside
};

// The surface around the cells that are not 0, smoothed over two cells: between the centres of
// neighbours where the smoothed values cross a half (surface nets: Gibson, Constrained Elastic
// Surface Nets, MICCAI 1998). Closed unless it leaves the box.
CellSurface surfaceAround(const Cells& cells, const std::vector<uint8_t>& inside);

}  // namespace doppel
