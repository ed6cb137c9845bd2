#include "trainer/import/coverage.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <vector>

#include "trainer/data/pose.h"

namespace doppel {

std::string whatIsNotSeen(const Capture& capture) {
    constexpr double kLargestGap = 120;  // degrees
    std::vector<double> headings;        // 0: towards the camera, 90: to its right
    for (const Theta& theta : capture.theta) {
        const glm::dvec3 front = jointRotation(theta, 0) * glm::dvec3(0, 0, 1);
        headings.push_back(glm::degrees(std::atan2(front.x, -front.z)));
    }
    if (headings.empty()) return {};
    std::ranges::sort(headings);
    double gap = 0, middle = 0;
    for (size_t i = 0; i < headings.size(); ++i) {
        const bool last = i + 1 == headings.size();
        const double next = last ? headings[0] + 360 : headings[i + 1];
        if (next - headings[i] <= gap) continue;
        gap = next - headings[i];
        middle = (next + headings[i]) / 2;
    }
    if (gap <= kLargestGap) return {};
    middle = std::remainder(middle, 360);
    // Who faces the picture's right shows the camera the right side.
    const char* side = std::abs(middle) < 45    ? "the front"
                       : std::abs(middle) > 135 ? "the back"
                       : middle > 0             ? "the right side"
                                                : "the left side";
    return fmt::format(
        "no frame shows {}: {:.0f} of 360 degrees lie between one view and the next, and what is "
        "there will be made up; a clip in which the person turns once shows all",
        side, gap);
}

}  // namespace doppel
