#include "nn/body/texel_places.h"

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>

namespace doppel {

namespace {

glm::dvec2 toTexels(const BodyModel& body, int32_t uv, int size) {
    const float* p = &body.uvs[2 * static_cast<size_t>(uv)];
    return glm::dvec2(p[0], p[1]) * static_cast<double>(size) - 0.5;  // centres: whole numbers
}

double across(glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; }

// Barycentrics of the point of a triangle that is nearest to p, and its distance.
std::pair<glm::dvec3, double> nearestInTriangle(const std::array<glm::dvec2, 3>& t, glm::dvec2 p) {
    double area = across(t[1] - t[0], t[2] - t[0]);
    if (area != 0) {
        glm::dvec3 b(across(t[1] - p, t[2] - p), across(t[2] - p, t[0] - p),
                     across(t[0] - p, t[1] - p));
        b /= area;
        if (b.x >= 0 && b.y >= 0 && b.z >= 0) return {b, 0};
    }
    std::pair<glm::dvec3, double> best{glm::dvec3(1, 0, 0), INFINITY};
    for (int i = 0; i < 3; ++i) {
        int j = (i + 1) % 3;
        glm::dvec2 from = t[size_t(i)], edge = t[size_t(j)] - from;
        double length2 = glm::dot(edge, edge);
        double along = length2 > 0 ? std::clamp(glm::dot(p - from, edge) / length2, 0.0, 1.0) : 0;
        double distance = glm::length(p - from - along * edge);
        if (distance >= best.second) continue;
        best = {glm::dvec3(0), distance};
        best.first[i] = 1 - along;
        best.first[j] += along;
    }
    return best;
}

}  // namespace

std::vector<TexelPlace> texelPlaces(const BodyModel& body, int size) {
    constexpr double kReach = 1.5;  // texels; the diagonal neighbour of a chart's texel
    auto side = static_cast<size_t>(size);
    std::vector<TexelPlace> places(side * side);
    std::vector<double> distances(side * side, INFINITY);
    for (size_t f = 0; f < body.uvFaces.size() / 3; ++f) {
        std::array<glm::dvec2, 3> t;
        for (size_t i = 0; i < 3; ++i) t[i] = toTexels(body, body.uvFaces[3 * f + i], size);
        glm::dvec2 low = glm::min(t[0], glm::min(t[1], t[2])) - kReach;
        glm::dvec2 high = glm::max(t[0], glm::max(t[1], t[2])) + kReach;
        auto texel = [&](double x) {
            return static_cast<size_t>(std::clamp(x, 0.0, static_cast<double>(size - 1)));
        };
        for (size_t y = texel(std::ceil(low.y)); y <= texel(std::floor(high.y)); ++y)
            for (size_t x = texel(std::ceil(low.x)); x <= texel(std::floor(high.x)); ++x) {
                auto [b, distance] =
                    nearestInTriangle(t, {static_cast<double>(x), static_cast<double>(y)});
                if (distance > kReach || distance >= distances[y * side + x]) continue;
                distances[y * side + x] = distance;
                places[y * side + x] = {
                    static_cast<int32_t>(f),
                    {static_cast<float>(b.x), static_cast<float>(b.y), static_cast<float>(b.z)}};
            }
    }
    return places;
}

}  // namespace doppel
