#include "trainer/avatar/mix/colour_mixture.h"

#include <algorithm>
#include <cmath>

namespace doppel {

namespace {

double squared(const glm::dvec3& x) { return glm::dot(x, x); }

}  // namespace

ColourMixture::ColourMixture(std::vector<glm::dvec3> colours) {
    constexpr int kPasses = 20;
    // From dark to light, a quarter each, where clusters begin.
    std::ranges::stable_sort(colours, {}, &glm::dvec3::x);
    std::vector<size_t> cluster(colours.size());
    for (size_t i = 0; i < colours.size(); ++i) cluster[i] = i * kClusters / colours.size();
    for (int pass = 0; pass < kPasses; ++pass) {
        fitTo(colours, cluster);
        for (size_t i = 0; i < colours.size(); ++i)
            for (size_t k = 0; k < kClusters; ++k)
                if (squared(colours[i] - means_[k]) < squared(colours[i] - means_[cluster[i]]))
                    cluster[i] = k;
    }
    fitTo(colours, cluster);
}

double ColourMixture::cost(const glm::dvec3& colour) const {
    constexpr double kFloor = 1e-8;
    double density = kFloor;
    for (size_t k = 0; k < kClusters; ++k)
        density += shares_[k] / std::pow(variances_[k], 1.5) *
                   std::exp(-squared(colour - means_[k]) / (2 * variances_[k]));
    return -std::log(density);
}

// A cluster that nothing belongs to keeps its mean.
void ColourMixture::fitTo(const std::vector<glm::dvec3>& colours,
                          const std::vector<size_t>& cluster) {
    constexpr double kLeastVariance = 16;
    std::array<glm::dvec3, kClusters> sums{};
    std::array<double, kClusters> counts{}, squares{};
    for (size_t i = 0; i < colours.size(); ++i) {
        sums[cluster[i]] += colours[i];
        ++counts[cluster[i]];
    }
    for (size_t k = 0; k < kClusters; ++k)
        if (counts[k] > 0) means_[k] = sums[k] / counts[k];
    for (size_t i = 0; i < colours.size(); ++i)
        squares[cluster[i]] += squared(colours[i] - means_[cluster[i]]);
    for (size_t k = 0; k < kClusters; ++k) {
        shares_[k] = counts[k] / double(colours.size());
        variances_[k] = std::max(kLeastVariance, counts[k] > 0 ? squares[k] / (3 * counts[k]) : 0);
    }
}

}  // namespace doppel
