#include "nn/body/feet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <numbers>

#include "nn/body/joint.h"

namespace doppel {

namespace {

constexpr std::array<size_t, 2> kFeet{joint::kLeftFoot, joint::kRightFoot};
// Of a vertex's weights those of the joint where the toes begin: from here on its front is a toe's.
constexpr double kLeast = .2, kWhole = .8;
// How much of a slit is closed: so many metres, for deeper down its walls touch and nobody sees
// them; of what is less deep a part is left, since walls that all came to lie in one surface would
// show through each other.
constexpr double kClosed = .004, kLeft = .1;
// Which vertices the hull is of.
constexpr float kOfFoot = .02f;

glm::dvec3 placeOf(std::span<const float> rows, int64_t v) {
    const float* row = &rows[static_cast<size_t>(3 * v)];
    return {row[0], row[1], row[2]};
}

float weightOf(const BodyModel& body, int64_t v, size_t joint) {
    return body.weights[static_cast<size_t>(kJointCount * v) + joint];
}

// Evenly over the sphere (a Fibonacci lattice), four degrees apart: of toes that is a hull to some
// hundredths of a millimetre.
std::vector<glm::dvec3> directions() {
    constexpr int kCount = 2000;
    std::vector<glm::dvec3> result;
    for (int i = 0; i < kCount; ++i) {
        const double z = 1 - (2 * i + 1.) / kCount, radius = std::sqrt(1 - z * z);
        const double angle = i * std::numbers::pi * (3 - std::sqrt(5.));
        result.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
    }
    return result;
}

}  // namespace

std::vector<float> toeShares(const BodyModel& body) {
    std::vector<float> shares(static_cast<size_t>(body.vertexCount));
    for (int64_t v = 0; v < body.modelVertices; ++v) {
        double weight = 0;
        for (size_t foot : kFeet) weight += weightOf(body, v, foot);
        shares[static_cast<size_t>(v)] =
            static_cast<float>(std::clamp((weight - kLeast) / (kWhole - kLeast), 0., 1.));
    }
    return shares;
}

std::vector<float> closedToes(const BodyModel& body) {
    const std::vector<float> shares = toeShares(body);
    std::vector<float> result(body.templateVertices.size());
    for (size_t foot : kFeet) {
        std::vector<int64_t> own;
        for (int64_t v = 0; v < body.modelVertices; ++v)
            if (weightOf(body, v, foot) > kOfFoot) own.push_back(v);
        // Of each plane that touches the foot, how far it is from where the model has its origin.
        const std::vector<glm::dvec3> normals = directions();
        std::vector<double> heights;
        for (const glm::dvec3& normal : normals) {
            double most = -1e9;
            for (int64_t v : own)
                most = std::max(most, glm::dot(normal, placeOf(body.templateVertices, v)));
            heights.push_back(most);
        }
        for (int64_t v : own) {
            const glm::dvec3 place = placeOf(body.templateVertices, v);
            size_t nearest = 0;
            double least = 1e9;
            for (size_t i = 0; i < normals.size(); ++i) {
                const double depth = heights[i] - glm::dot(normals[i], place);
                if (depth < least) least = depth, nearest = i;
            }
            const double closed = least - std::max(kLeft * least, least - kClosed);
            const glm::dvec3 way =
                double{shares[static_cast<size_t>(v)]} * closed * normals[nearest];
            for (int axis = 0; axis < 3; ++axis)
                result[static_cast<size_t>(3 * v + axis)] = static_cast<float>(way[axis]);
        }
    }
    return result;
}

SparseMatrix movedWithToes(const BodyModel& body, std::span<const float> offsets, double width) {
    constexpr double kReach = 2.5;  // deviations
    const std::vector<float> shares = toeShares(body);
    std::vector<float> rest = body.templateVertices;
    std::ranges::transform(rest, offsets, rest.begin(), std::plus());
    // As much of the surface as a vertex stands for: slits have most of the vertices, and no area.
    std::vector<double> areas(static_cast<size_t>(body.vertexCount));
    for (int64_t f = 0; f < body.modelFaces; ++f) {
        const int32_t* face = &body.faces[static_cast<size_t>(3 * f)];
        const glm::dvec3 a = placeOf(rest, face[0]);
        const double area =
            glm::length(glm::cross(placeOf(rest, face[1]) - a, placeOf(rest, face[2]) - a)) / 6;
        for (int k = 0; k < 3; ++k) areas[static_cast<size_t>(face[k])] += area;
    }
    std::array<std::vector<int64_t>, 2> feet;
    for (int64_t v = 0; v < body.modelVertices; ++v)
        for (size_t side : {0, 1})
            if (weightOf(body, v, kFeet[side]) > kOfFoot) feet[side].push_back(v);
    SparseMatrix rows;
    rows.columns = body.vertexCount;
    for (int64_t v = 0; v < body.vertexCount; ++v) {
        const double share = width > 0 ? double{shares[static_cast<size_t>(v)]} : 0;
        std::map<int64_t, double> row;
        double sum = 0;
        if (share > 0) {
            const size_t side = weightOf(body, v, kFeet[0]) < weightOf(body, v, kFeet[1]);
            for (int64_t w : feet[side]) {
                const glm::dvec3 way = (placeOf(rest, w) - placeOf(rest, v)) / width;
                const double square = glm::dot(way, way);
                if (square > kReach * kReach) continue;
                sum += row[w] = areas[static_cast<size_t>(w)] * std::exp(-square / 2);
            }
        }
        for (auto& [w, weight] : row) weight *= sum > 0 ? share / sum : 0;
        row[v] += sum > 0 ? 1 - share : 1;
        for (const auto& [w, weight] : row) rows.add(w, static_cast<float>(weight));
        rows.endRow();
    }
    return rows;
}

}  // namespace doppel
