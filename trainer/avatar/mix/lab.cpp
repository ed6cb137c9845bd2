#include "trainer/avatar/mix/lab.h"

#include <algorithm>
#include <cmath>

namespace doppel {

namespace {

// sRGB's primaries in XYZ (IEC 61966-2-1), column by column, and its white.
const glm::dmat3 kToXyz(.4124564, .2126729, .0193339, .3575761, .7151522, .1191920, .1804375,
                        .0721750, .9503041);
constexpr glm::dvec3 kWhite(.95047, 1, 1.08883);
constexpr double kCube = 216. / 24389, kSlope = 24389. / 27;

}  // namespace

glm::dvec3 labOf(const glm::dvec3& srgb) {
    glm::dvec3 linear;
    for (int c = 0; c < 3; ++c) {
        const double x = std::clamp(srgb[c], 0., 1.);
        linear[c] = x <= .04045 ? x / 12.92 : std::pow((x + .055) / 1.055, 2.4);
    }
    glm::dvec3 f = kToXyz * linear / kWhite;
    for (int c = 0; c < 3; ++c) f[c] = f[c] > kCube ? std::cbrt(f[c]) : (kSlope * f[c] + 16) / 116;
    return {116 * f.y - 16, 500 * (f.x - f.y), 200 * (f.y - f.z)};
}

}  // namespace doppel
