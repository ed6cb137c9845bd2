#include "trainer/smooth.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>

namespace doppel {

namespace {

glm::dquat rotation(const Theta& theta, size_t joint) {
    glm::dvec3 v(theta[3 * joint], theta[3 * joint + 1], theta[3 * joint + 2]);
    double angle = glm::length(v);
    return angle > 0 ? glm::angleAxis(angle, v / angle) : glm::dquat(1, 0, 0, 0);
}

void setRotation(Theta& theta, size_t joint, glm::dquat q) {
    if (q.w < 0) q = -q;
    glm::dvec3 axis(q.x, q.y, q.z);
    double sine = glm::length(axis);
    double angle = 2 * std::atan2(sine, q.w);
    glm::dvec3 v = sine > 0 ? angle / sine * axis : glm::dvec3(0);
    for (int k = 0; k < 3; ++k)
        theta[3 * joint + static_cast<size_t>(k)] = static_cast<float>(v[k]);
}

}  // namespace

Motion smoothed(Motion motion, double deviation) {
    if (deviation <= 0) return motion;
    const std::vector<Theta> theta = motion.theta;
    const std::vector<Trans> trans = motion.trans;
    constexpr size_t kJoints = 24;
    auto reach = static_cast<int64_t>(std::ceil(3 * deviation));
    auto count = static_cast<int64_t>(motion.size());
    for (int64_t i = 0; i < count; ++i) {
        int64_t r = std::min({reach, i, count - 1 - i});
        if (r == 0) continue;
        double total = 0;
        std::array<double, 3> place{};
        std::array<glm::dquat, kJoints> sums;
        sums.fill(glm::dquat(0, 0, 0, 0));
        for (int64_t k = i - r; k <= i + r; ++k) {
            auto frame = static_cast<size_t>(k);
            double x = static_cast<double>(k - i) / deviation, weight = std::exp(-x * x / 2);
            total += weight;
            for (size_t c = 0; c < 3; ++c)
                place[c] += weight * static_cast<double>(trans[frame][c]);
            for (size_t j = 0; j < kJoints; ++j) {
                glm::dquat q = rotation(theta[frame], j);
                if (glm::dot(q, rotation(theta[static_cast<size_t>(i)], j)) < 0) q = -q;
                sums[j] = sums[j] + weight * q;
            }
        }
        auto at = static_cast<size_t>(i);
        for (size_t c = 0; c < 3; ++c) motion.trans[at][c] = static_cast<float>(place[c] / total);
        for (size_t j = 0; j < kJoints; ++j)
            setRotation(motion.theta[at], j, glm::normalize(sums[j]));
    }
    return motion;
}

}  // namespace doppel
