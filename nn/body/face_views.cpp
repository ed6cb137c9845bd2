#include "nn/body/face_views.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

namespace doppel {

namespace {

// From the middle to the sides, in parts of the face's extent.
constexpr double kFade = .35;
// Over which the head's normals are smoothed at the sides, metres: noses and eyes are smaller.
constexpr double kSmooth = .025, kLeastWeight = .05;
// Of the face's vertices: these tell where it looks.
constexpr size_t kTelling = 100;

}  // namespace

SparseMatrix viewNormals(const BodyModel& body, double middle) {
    const auto at = [&](int64_t v) {
        const float* place = &body.templateVertices[static_cast<size_t>(3 * v)];
        return glm::dvec3(place[0], place[1], place[2]);
    };
    std::vector<int64_t> face;
    glm::dvec3 low(1e9), high(-1e9);
    if (middle > 0)
        for (int64_t v = 0; v < body.modelVertices; ++v) {
            if (!body.face[static_cast<size_t>(v)]) continue;
            face.push_back(v);
            low = glm::min(low, at(v));
            high = glm::max(high, at(v));
        }
    SparseMatrix rows;
    rows.columns = body.vertexCount;
    for (int64_t v = 0; v < body.vertexCount; ++v) {
        if (face.empty() || v >= body.modelVertices || !body.face[static_cast<size_t>(v)]) {
            rows.add(v, 1);
            rows.endRow();
            continue;
        }
        const glm::dvec3 aside = (2. * at(v) - low - high) / glm::max(high - low, 1e-6);
        const double whole =
            std::clamp((middle + kFade - std::hypot(aside.x, aside.y)) / kFade, 0., 1.);
        std::map<int64_t, double> row;
        double sum = 0;
        for (int64_t w = 0; w < body.modelVertices; ++w) {
            const glm::dvec3 way = (at(w) - at(v)) / kSmooth;
            const double weight = std::exp(-glm::dot(way, way) / 2);
            if (weight < kLeastWeight) continue;
            row[w] = weight;
            sum += weight;
        }
        for (auto& [w, weight] : row) weight *= (1 - whole) / sum;
        if (whole == 1) row.clear();
        if (whole > 0) {
            const size_t step = std::max<size_t>(face.size() / kTelling, 1),
                         count = (face.size() + step - 1) / step;
            for (size_t k = 0; k < face.size(); k += step)
                row[face[k]] += whole / static_cast<double>(count);
        }
        for (const auto& [w, weight] : row) rows.add(w, static_cast<float>(weight));
        rows.endRow();
    }
    return rows;
}

}  // namespace doppel
