// ICC profiles, by Little CMS: colours of cameras whose red is not sRGB's (Display P3 of
// telephones, Adobe RGB) brought to sRGB.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace doppel {

struct Image;

// CIE xy of red, green, blue and white.
struct Primaries {
    std::array<double, 2> red, green, blue, white;
};

// A profile of these primaries and sRGB's curve.
std::vector<uint8_t> profileOf(const Primaries& primaries);

// In place, relative to white; alpha stays. What has one or two channels stays, and so do colours
// whose profile is damaged, is not of RGB, or is sRGB's but for rounding.
void convertToSrgb(Image& image, std::span<const uint8_t> profile);

}  // namespace doppel
