// The colours of one thing.
#pragma once

#include <array>
#include <glm/glm.hpp>
#include <vector>

namespace doppel {

// Round Gaussians of L*a*b* around the means of k-means clusters.
class ColourMixture {
public:
    // Of at least one.
    explicit ColourMixture(std::vector<glm::dvec3> colours);

    // -log of the density, up to a constant; bounded, for any colour may be anywhere once.
    double cost(const glm::dvec3& colour) const;

private:
    static constexpr size_t kClusters = 4;

    void fitTo(const std::vector<glm::dvec3>& colours, const std::vector<size_t>& cluster);

    std::array<glm::dvec3, kClusters> means_{};
    std::array<double, kClusters> shares_{}, variances_{};
};

}  // namespace doppel
