// The square around a person that a landmark network looks at, and pictures cut from it.
#pragma once

#include <array>
#include <vector>

#include "engine/io/image.h"

namespace doppel {

using Point2 = std::array<double, 2>;  // pixels, centres at a half
using Point3 = std::array<double, 3>;

struct Roi {
    Point2 centre{};
    double side = 0;      // pixels
    double rotation = 0;  // radians in [−π, π), clockwise on the screen; upright is 0

    // From the square, [0, 1] across and down, to the picture.
    Point2 toPicture(const Point2& inside) const;
    // The other way round.
    Point2 fromPicture(const Point2& point) const;
};

// Mid-hip and a point beyond the head: the square is 1.25 times as wide as the circle about the
// first through the second, and turned so that the second is above.
Roi roiOfBody(const Point2& centre, const Point2& scalePoint);

// The whole picture, enlarged to a square about its middle.
Roi roiOfPicture(int width, int height);

enum class Outside { Black, Edge };

// [3,size,size] in [0, 1], one bilinear tap per pixel, though squares shrink: the networks were
// trained so. Outside of the picture is black, or its edge goes on.
std::vector<float> crop(const Image& rgb, const Roi& roi, int size, Outside outside);

}  // namespace doppel
