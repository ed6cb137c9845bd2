// What is behind everything: a colour, a picture, or a frame of a capture.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/io/image.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// One of them at most is shown.
struct BackdropSource {
    std::array<float, 3> colour{};   // sRGB-encoded in [0,1]
    const Image* picture = nullptr;  // it covers all
    const Picture* frame = nullptr;  // whole, as large as there is room; the colour beside it
};

// Pixels [height,width] of R, G, B, A.
std::vector<uint32_t> backdropPixels(int width, int height, const BackdropSource& backdrop);

}  // namespace doppel
