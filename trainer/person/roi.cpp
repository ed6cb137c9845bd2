#include "trainer/person/roi.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/error.h"

namespace doppel {

Point2 Roi::toPicture(const Point2& inside) const {
    const double a = (inside[0] - .5) * side, b = (inside[1] - .5) * side;
    const double c = std::cos(rotation), s = std::sin(rotation);
    return {centre[0] + a * c - b * s, centre[1] + a * s + b * c};
}

Point2 Roi::fromPicture(const Point2& point) const {
    const double x = point[0] - centre[0], y = point[1] - centre[1];
    const double c = std::cos(rotation), s = std::sin(rotation);
    return {(x * c + y * s) / side + .5, (y * c - x * s) / side + .5};
}

Roi roiOfBody(const Point2& centre, const Point2& scalePoint) {
    const double dx = scalePoint[0] - centre[0], dy = scalePoint[1] - centre[1];
    constexpr double kPi = std::numbers::pi;
    const double turn = kPi / 2 - std::atan2(-dy, dx);
    return {centre, 1.25 * 2 * std::hypot(dx, dy),
            turn - 2 * kPi * std::floor((turn + kPi) / (2 * kPi))};
}

Roi roiOfPicture(int width, int height) {
    return {{width / 2., height / 2.}, double(std::max(width, height)), 0};
}

std::vector<float> crop(const Image& rgb, const Roi& roi, int size, Outside outside) {
    CHECK(rgb.channels == 3 && rgb.width > 0 && rgb.height > 0, "a picture has three colours");
    const auto pixels = size_t(size) * size_t(size);
    std::vector<float> planes(3 * pixels);
    const Point2 first = roi.toPicture({.5 / size, .5 / size});
    const double c = std::cos(roi.rotation) * roi.side / size;
    const double s = std::sin(roi.rotation) * roi.side / size;
    const int right = rgb.width - 1, bottom = rgb.height - 1;
    for (int j = 0; j < size; ++j) {
        for (int i = 0; i < size; ++i) {
            // Far enough for any clamping, and within what an int holds.
            const double x = std::clamp(first[0] + i * c - j * s - .5, -4., rgb.width + 4.);
            const double y = std::clamp(first[1] + i * s + j * c - .5, -4., rgb.height + 4.);
            const int x0 = int(std::floor(x)), y0 = int(std::floor(y));
            const auto fx = float(x - x0), fy = float(y - y0);
            std::array<float, 3> colour{};
            for (int corner = 0; corner < 4; ++corner) {
                const int px = x0 + corner % 2, py = y0 + corner / 2;
                const bool inside = px >= 0 && px <= right && py >= 0 && py <= bottom;
                if (outside == Outside::Black && !inside) continue;
                const float weight =
                    (corner % 2 ? fx : 1 - fx) * (corner / 2 ? fy : 1 - fy) / 255.f;
                const uint8_t* pixel =
                    rgb.pixel(std::clamp(px, 0, right), std::clamp(py, 0, bottom));
                for (size_t k = 0; k < 3; ++k) colour[k] += weight * float(pixel[k]);
            }
            for (size_t k = 0; k < 3; ++k)
                planes[k * pixels + size_t(j) * size_t(size) + size_t(i)] = colour[k];
        }
    }
    return planes;
}

}  // namespace doppel
