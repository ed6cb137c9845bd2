#include "nn/body/seams.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <map>
#include <utility>

namespace doppel {

namespace {

// What the texture shows at a place, in texels, times `factor`.
void addTexels(SparseMatrix& to, glm::dvec2 place, int size, double factor) {
    std::array<int64_t, 2> low;
    std::array<double, 2> share;
    for (int axis : {0, 1}) {
        const double at = std::clamp(place[axis] - .5, 0., double(size - 1));
        low[size_t(axis)] = std::min<int64_t>(static_cast<int64_t>(at), std::max(0, size - 2));
        share[size_t(axis)] = at - static_cast<double>(low[size_t(axis)]);
    }
    for (int64_t y : {0, 1})
        for (int64_t x : {0, 1}) {
            const double weight = (x ? share[0] : 1 - share[0]) * (y ? share[1] : 1 - share[1]);
            if (weight > 0)
                to.add((low[1] + y) * size + low[0] + x, static_cast<float>(factor * weight));
        }
}

}  // namespace

SparseMatrix seamDifferences(const BodyModel& body, int size) {
    using Edge = std::pair<int32_t, int32_t>;
    // Of each edge of the mesh, its ends on the atlas as the first face that has it has them.
    std::map<Edge, Edge> onAtlas;
    SparseMatrix rows;
    rows.columns = int64_t{size} * size;
    const auto uv = [&](int32_t row) {
        const auto i = 2 * static_cast<size_t>(row);
        return double(size) * glm::dvec2(body.uvs[i], body.uvs[i + 1]);
    };
    for (size_t f = 0; f < body.faces.size(); f += 3)
        for (size_t k = 0; k < 3; ++k) {
            const size_t a = f + k, b = f + (k + 1) % 3;
            Edge edge{body.faces[a], body.faces[b]}, here{body.uvFaces[a], body.uvFaces[b]};
            if (edge.first > edge.second) {
                std::swap(edge.first, edge.second);
                std::swap(here.first, here.second);
            }
            const auto [before, isFirst] = onAtlas.emplace(edge, here);
            if (isFirst || before->second == here) continue;
            const Edge there = before->second;
            const std::array<glm::dvec2, 4> ends{uv(here.first), uv(here.second), uv(there.first),
                                                 uv(there.second)};
            const double length =
                std::max(glm::length(ends[1] - ends[0]), glm::length(ends[3] - ends[2]));
            const auto count = std::max<int64_t>(1, std::llround(length));
            for (int64_t i = 0; i < count; ++i) {
                const double t = (double(i) + .5) / double(count);
                addTexels(rows, ends[0] + t * (ends[1] - ends[0]), size, 1);
                addTexels(rows, ends[2] + t * (ends[3] - ends[2]), size, -1);
                rows.endRow();
            }
        }
    return rows;
}

}  // namespace doppel
