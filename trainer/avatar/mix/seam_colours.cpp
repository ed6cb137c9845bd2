#include "trainer/avatar/mix/seam_colours.h"

#include <algorithm>

namespace doppel {

std::vector<std::optional<glm::dvec3>> coloursAwayFromSeams(Garment garment,
                                                            std::span<const Garment> garments,
                                                            std::span<const glm::dvec3> colours,
                                                            const Adjacency& adjacency) {
    constexpr int kRim = 2, kReach = 8;  // edges, of about a centimetre
    constexpr std::ptrdiff_t kFewest = 20;
    std::vector<char> inside(garments.size());
    for (size_t v = 0; v < garments.size(); ++v) inside[v] = garments[v] == garment;
    if (std::ranges::count(inside, 1) < kFewest)
        return std::vector<std::optional<glm::dvec3>>(garments.size());
    for (int ring = 0; ring < kRim; ++ring) {
        std::vector<char> next = inside;
        for (size_t v = 0; v < garments.size(); ++v)
            if (std::ranges::any_of(adjacency.of(v), [&](int32_t n) { return !inside[size_t(n)]; }))
                next[v] = 0;
        if (std::ranges::count(next, 1) < kFewest) break;  // a ribbon is all seam
        inside = std::move(next);
    }
    std::vector<std::optional<glm::dvec3>> known(garments.size());
    for (size_t v = 0; v < garments.size(); ++v)
        if (inside[v]) known[v] = colours[v];
    for (int ring = 0; ring < kRim + kReach; ++ring) {
        std::vector<std::optional<glm::dvec3>> next = known;
        for (size_t v = 0; v < garments.size(); ++v) {
            if (known[v]) continue;
            glm::dvec3 sum(0);
            double count = 0;
            for (int32_t n : adjacency.of(v))
                if (known[size_t(n)]) sum += *known[size_t(n)], ++count;
            if (count > 0) next[v] = sum / count;
        }
        known = std::move(next);
    }
    return known;
}

std::optional<double> shareBetween(const glm::dvec3& texel, const glm::dvec3& own,
                                   const glm::dvec3& other) {
    constexpr double kContrast = .08;  // of sRGB
    constexpr double kUnlike = .5;     // of the two's distance
    const glm::dvec3 axis = own - other;
    const double length2 = glm::dot(axis, axis);
    if (length2 < kContrast * kContrast) return std::nullopt;
    const double along = glm::dot(texel - other, axis) / length2;
    const double aside = glm::length(texel - other - along * axis) / std::sqrt(length2);
    if (aside > kUnlike) return std::nullopt;
    return std::clamp(along, 0., 1.);
}

}  // namespace doppel
