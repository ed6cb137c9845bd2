#include "viewer/pose/shape_names.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <numbers>
#include <numeric>
#include <vector>

namespace doppel {

namespace {

constexpr double kNothing = .003;

struct Measure {
    const char* name;
    const char *more, *less;  // what a coefficient is called that makes it grow, and shrink
    double ShapeMeasures::*value;
};
constexpr std::array<Measure, 6> kMeasures = {{
    {"height", "taller", "shorter", &ShapeMeasures::height},
    {"girth", "heavier", "slimmer", &ShapeMeasures::girth},
    {"legs", "longer legs", "shorter legs", &ShapeMeasures::legs},
    {"arms", "longer arms", "shorter arms", &ShapeMeasures::arms},
    {"shoulders", "broader shoulders", "narrower shoulders", &ShapeMeasures::shoulders},
    {"hips", "wider hips", "narrower hips", &ShapeMeasures::hips},
}};

ShapeName nameOf(const ShapeMeasures& less, const ShapeMeasures& more) {
    const double growth = std::log(more.height / less.height) / 2;
    ShapeName result;
    std::array<double, kMeasures.size()> changes;
    for (size_t m = 0; m < kMeasures.size(); ++m) {
        const auto value = kMeasures[m].value;
        const double change = std::log(more.*value / less.*value) / 2;
        // Who is taller has longer legs; but hips that grow less than the rest are not narrower.
        const double against = change - (m > 0 ? growth : 0);
        const double clear = std::min(std::abs(change), std::abs(against));
        changes[m] = change * against > 0 ? std::copysign(clear, change) : 0;
        result.effect += fmt::format("{}{} {:+.1f} cm", m > 0 ? ", " : "", kMeasures[m].name,
                                     100 * (more.*value - less.*value) / 2);
    }
    std::array<size_t, kMeasures.size()> order;
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(order, std::greater{}, [&](size_t m) { return std::abs(changes[m]); });
    const double most = std::abs(changes[order[0]]);
    for (size_t k = 0; k < 2; ++k) {
        const double change = changes[order[k]];
        if (std::abs(change) < std::max(kNothing, most / 2)) break;
        const Measure& measure = kMeasures[order[k]];
        result.name += (k > 0 ? ", " : "") + std::string(change > 0 ? measure.more : measure.less);
    }
    if (result.name.empty()) result.name = "fine form";
    return result;
}

}  // namespace

ShapeMeasures measured(const BodyModel& body, std::span<const double> beta) {
    const std::vector<double> verts = shapedVertices(body, beta), joints = restJoints(body, beta);
    const auto vertex = [&](int32_t v) {
        const double* x = &verts[3 * static_cast<size_t>(v)];
        return glm::dvec3(x[0], x[1], x[2]);
    };
    const auto length = [&](std::initializer_list<size_t> chain) {
        double sum = 0;
        for (auto j = chain.begin(); j + 1 != chain.end(); ++j) {
            const double *a = &joints[3 * *j], *b = &joints[3 * *(j + 1)];
            sum += std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
        }
        return sum;
    };
    using namespace joint;
    ShapeMeasures found;
    double low = INFINITY, high = -INFINITY, volume = 0;
    for (size_t i = 1; i < verts.size(); i += 3)
        low = std::min(low, verts[i]), high = std::max(high, verts[i]);
    for (size_t i = 0; i + 2 < body.faces.size(); i += 3)
        volume += glm::dot(vertex(body.faces[i]),
                           glm::cross(vertex(body.faces[i + 1]), vertex(body.faces[i + 2]))) /
                  6;
    found.height = high - low;
    found.girth = 2 * std::sqrt(std::numbers::pi * volume / found.height);
    found.legs =
        (length({kLeftHip, kLeftKnee, kLeftAnkle}) + length({kRightHip, kRightKnee, kRightAnkle})) /
        2;
    found.arms = (length({kLeftShoulder, kLeftElbow, kLeftWrist}) +
                  length({kRightShoulder, kRightElbow, kRightWrist})) /
                 2;
    found.shoulders = length({kLeftShoulder, kRightShoulder});
    found.hips = length({kLeftHip, kRightHip});
    return found;
}

std::array<ShapeName, BodyModel::kShapes> shapeNames(const BodyModel& body) {
    std::array<ShapeName, BodyModel::kShapes> names;
    for (size_t k = 0; k < names.size(); ++k) {
        std::vector<double> beta(names.size());
        beta[k] = -1;
        const ShapeMeasures less = measured(body, beta);
        beta[k] = 1;
        names[k] = nameOf(less, measured(body, beta));
    }
    return names;
}

}  // namespace doppel
