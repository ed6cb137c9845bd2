#include "trainer/motion/upright.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "trainer/motion/skeleton_motion.h"

namespace doppel {

namespace {

enum class Up : uint8_t { MinusY, Y, Z };

// How much the body's lowest joint goes up and down along an axis: feet, or whatever else a person
// lies or kneels on, stay on the ground.
double floorSpread(const Motion& motion, const glm::dvec3& axis) {
    constexpr size_t kMost = 200;
    std::vector<double> lows;
    for (size_t f = 0; f < motion.size(); f += (motion.size() + kMost - 1) / kMost) {
        double low = std::numeric_limits<double>::infinity();
        for (const glm::dvec3& place : placeJoints(motion.theta[f], motion.trans[f]))
            low = std::min(low, glm::dot(place, axis));
        lows.push_back(low);
    }
    std::ranges::sort(lows);
    return lows[lows.size() * 9 / 10] - lows[lows.size() / 10];
}

Up upOf(const Motion& motion) {
    if (!motion.cameras.empty()) return Up::MinusY;
    glm::dvec3 up(0);
    for (const Theta& theta : motion.theta) up += jointRotation(theta, 0) * glm::dvec3(0, 1, 0);
    up /= static_cast<double>(std::max<size_t>(motion.size(), 1));
    const std::array<glm::dvec3, 3> axes = {glm::dvec3(0, -1, 0), {0, 1, 0}, {0, 0, 1}};
    size_t best = -up.y >= std::max(up.y, up.z) ? 0 : up.y >= up.z ? 1 : 2;
    // Somebody who lies, crawls or tumbles: what the ground says counts more, where it says much.
    if (motion.size() > 1 && glm::dot(up, axes[best]) < .5) {
        std::array<double, 3> spread;
        for (size_t a = 0; a < 3; ++a) spread[a] = floorSpread(motion, axes[a]);
        // Up and down are one line: which of them it is, the bodies say.
        const double y = std::min(spread[0], spread[1]);
        if (spread[2] < .5 * y) best = 2;
        if (y < .5 * spread[2] && best == 2) best = up.y >= 0 ? 1 : 0;
    }
    return static_cast<Up>(best);
}

}  // namespace

glm::dquat uprightRotation(const Motion& motion) {
    switch (upOf(motion)) {
        case Up::MinusY:
            return {0, 1, 0, 0};  // half a turn about x
        case Up::Y:
            return {1, 0, 0, 0};
        case Up::Z:
            break;
    }
    return glm::angleAxis(-std::acos(-1.0) / 2, glm::dvec3(1, 0, 0));
}

std::string takenAs(const Motion& motion) {
    if (!motion.cameras.empty()) return motion.note;
    const Up up = upOf(motion);
    return fmt::format("{}{}{}", motion.note, motion.note.empty() ? "" : ", ",
                       up == Up::MinusY ? "y down, as before a camera"
                       : up == Up::Y    ? "y up"
                                        : "z up");
}

}  // namespace doppel
