#include "trainer/motion/smooth.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>

#include "nn/body/joint.h"

namespace doppel {

Motion smoothed(Motion motion, double deviation) {
    if (deviation <= 0) return motion;
    const std::vector<Theta> theta = motion.theta;
    const std::vector<Trans> trans = motion.trans;
    constexpr size_t kJoints = joint::kCount;
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
                glm::dquat q = jointRotation(theta[frame], j);
                if (glm::dot(q, jointRotation(theta[static_cast<size_t>(i)], j)) < 0) q = -q;
                sums[j] = sums[j] + weight * q;
            }
        }
        auto at = static_cast<size_t>(i);
        for (size_t c = 0; c < 3; ++c) motion.trans[at][c] = static_cast<float>(place[c] / total);
        for (size_t j = 0; j < kJoints; ++j)
            setJointRotation(motion.theta[at], j, glm::normalize(sums[j]));
    }
    return motion;
}

}  // namespace doppel
