// What masks [H][W], > 0 inside, are worked on with.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace doppel {

// Distance in pixels from each pixel's centre to the nearest one inside (> 0) the mask; 0 inside;
// 1e9 everywhere where the mask is empty.
std::vector<float> distanceTo(std::span<const uint8_t> mask, int width, int height);

// Connected parts (4 neighbours) of the pixels for which mask is `inside`: their numbers from 0, or
// −1, and their sizes.
struct Parts {
    std::vector<int32_t> part;
    std::vector<size_t> sizes;
};
Parts connectedParts(std::span<const uint8_t> mask, bool inside, int width, int height);

// 255 where the mask is 0, and 0 elsewhere.
std::vector<uint8_t> invertedMask(std::span<const uint8_t> mask);

// Sums over (2 radius + 1)² squares, cut at the border.
std::vector<float> squareSums(std::span<const float> values, int width, int height, int radius);

// Linear light, [0,1], of 8-bit sRGB.
const std::array<float, 256>& linearTable();

// The edge to a fraction of a pixel: a pixel near it is a mixture of what lies well inside and well
// outside, in linear light, and belongs to the person where it holds more than half of it. A key
// alone would take mixtures of a dark sleeve and a bright screen for screen.
// rgb: [H][W][3].
void refineEdge(std::vector<uint8_t>& mask, std::span<const uint8_t> rgb, int width, int height);

}  // namespace doppel
