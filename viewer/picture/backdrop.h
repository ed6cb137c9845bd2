// What is behind everything: a colour, a picture, or a frame of a capture, which may be seen in
// front as well.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/io/image.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// The last three are of a capture's frame: behind the avatar; behind, and over it; and how far what
// is drawn is from it.
enum class Backdrop { Colour, Picture, Capture, Overlay, Difference };

// One of them at most is shown.
struct BackdropSource {
    std::array<float, 3> colour{};   // sRGB-encoded in [0,1]
    const Image* picture = nullptr;  // it covers all
    const Picture* frame = nullptr;  // whole, as large as there is room; the colour beside it
    // The person of the frame, where it has a mask, becomes half of all brightness darker or
    // brighter, so that a difference from the frame shows where the avatar does not cover her.
    bool marksPerson = false;
};

// Pixels [height,width] of R, G, B, A.
std::vector<uint32_t> backdropPixels(int width, int height, const BackdropSource& backdrop);

// How a frame in front is shown: the picture becomes opacity frame + (1 - opacity) picture, or
// min(times |picture - frame|, 255).
struct FrameInFront {
    Backdrop as = Backdrop::Overlay;  // or Difference
    double opacity = .5;
    int times = 1;
};
// frame: of the picture's size.
void putInFront(std::span<uint32_t> picture, std::span<const uint32_t> frame,
                const FrameInFront& how);

}  // namespace doppel
