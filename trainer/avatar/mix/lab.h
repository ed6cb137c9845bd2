// CIE L*a*b* (D65), in which equal distances look about equally different.
#pragma once

#include <array>
#include <glm/glm.hpp>

namespace doppel {

// Of sRGB-encoded values, cut to [0,1].
glm::dvec3 labOf(const std::array<double, 3>& srgb);
// The way back, cut to what sRGB has.
std::array<double, 3> srgbOf(const glm::dvec3& lab);

}  // namespace doppel
