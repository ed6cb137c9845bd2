#include "trainer/import/coverage.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/quaternion.hpp>

#include "trainer/data/pose.h"

namespace doppel {

std::vector<std::string> unseenSides(const Capture& capture) {
    constexpr double kSeen = 65;  // degrees from a heading, in which a side is seen
    struct Side {
        double heading;  // 0: towards the camera, 90: to its right, which shows the right side
        const char* name;
    };
    constexpr std::array<Side, 4> kSides{
        {{0, "front"}, {180, "back"}, {90, "right side"}, {-90, "left side"}}};
    if (capture.theta.empty()) return {};
    std::vector<std::string> unseen;
    for (const Side& side : kSides) {
        const bool seen = std::ranges::any_of(capture.theta, [&](const Theta& theta) {
            const glm::dvec3 front = jointRotation(theta, 0) * glm::dvec3(0, 0, 1);
            const double heading = glm::degrees(std::atan2(front.x, -front.z));
            return std::abs(std::remainder(heading - side.heading, 360)) <= kSeen;
        });
        if (!seen) unseen.emplace_back(side.name);
    }
    return unseen;
}

std::string whatIsNotSeen(const Capture& capture) {
    const std::vector<std::string> unseen = unseenSides(capture);
    if (unseen.empty()) return {};
    return fmt::format(
        "no frame shows the {}: what is there will be made up; a clip in which the person turns "
        "once "
        "shows all",
        fmt::join(unseen, ", the "));
}

}  // namespace doppel
