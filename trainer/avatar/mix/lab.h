// CIE L*a*b* (D65), in which equal distances look about equally different.
#pragma once

#include <glm/glm.hpp>

namespace doppel {

// Of sRGB-encoded values, cut to [0,1].
glm::dvec3 labOf(const glm::dvec3& srgb);

}  // namespace doppel
