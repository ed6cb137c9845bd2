// People taken out of pictures before a coloured screen, with a body in roughly the right pose as
// the hint which of the things before the screen is the person.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/data/frame_cache.h"

namespace doppel {

// The screen's colour as it varies over the picture. It is told by chromaticity (the shares of red,
// green and blue in linear light), which shadows and folds leave alone.
class ScreenKey {
public:
    // Learns from pictures of one size, by a camera that stands still: first the commonest
    // saturated colour along the border, then, cell by cell from there, what the screen looks like.
    // InputError, with `where` in front, where the border shows no such colour.
    ScreenKey(std::span<const std::shared_ptr<const Picture>> pictures, std::string_view where);

    // [H][W]: 0 the screen, 1 something before it.
    std::vector<float> foreground(const Picture& picture) const;

    // sRGB-encoded, 0 to 255, at the middle of the screen's brightness.
    std::array<int, 3> colour() const { return colour_; }

private:
    struct Cell {
        double red = 0, green = 0;  // shares
        double spread = 0;          // typical distance of the screen's pixels from these
        double brightness = 0;      // linear, mean of the channels
        bool known = false;
    };
    Cell at(double x, double y) const;

    int width_ = 0, height_ = 0, columns_ = 0, rows_ = 0;
    std::vector<Cell> cells_;
    std::array<int, 3> colour_{};
};

// What is along a picture's border, every other pixel of each row and column: [n][3] as in rgb.
std::vector<uint8_t> borderOf(const Picture& picture);

// "green" or "blue", where pictures are before such a screen for certain: it makes up half of what
// is along their borders, which are given. Empty: they are not.
std::string screenOf(std::span<const std::vector<uint8_t>> borders);

// Learns what the person's colours are and what those of other objects (all that the screen does
// not explain far from the body), and decides between them near the body.
class PersonKey {
public:
    // bodies: [H][W] per picture, > 0 where the body would be seen in the given pose.
    PersonKey(std::span<const std::shared_ptr<const Picture>> pictures,
              std::span<const std::vector<uint8_t>> bodies, std::string_view where);

    // [H][W], 255 the person. All 0 where nothing of the body is before the screen.
    std::vector<uint8_t> mask(const Picture& picture, std::span<const uint8_t> body) const;

    const ScreenKey& screen() const { return screen_; }

private:
    ScreenKey screen_;
    // Log of how much likelier a colour is the person's than another object's; empty: no objects.
    std::vector<float> favour_;
};

}  // namespace doppel
