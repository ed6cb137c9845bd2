// Whose colour is it, the person's or the background's? Histograms of both: over a whole clip,
// about each place of one picture, and the background of each place where the camera stands still.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/io/image.h"

namespace doppel {

// A part of a picture.
struct Rect {
    int left = 0, top = 0, right = 0, bottom = 0;
    int width() const { return right - left; }
    int height() const { return bottom - top; }
    bool empty() const { return right <= left || bottom <= top; }
};

// Over all pictures of a clip: how often colours are the person's and the background's. Its size
// does not depend on the clip's.
class ClipColours {
public:
    ClipColours();

    // share [H,W]: how surely each pixel is the person's. Those that are neither count for nothing.
    void add(const Image& rgb, const std::vector<float>& share);
    // Before density() is asked, after the last add().
    void finish();

    bool empty() const { return total_[0] == 0 || total_[1] == 0; }
    // Share of the person's (1) or the background's (0) pixels with about this colour.
    double density(bool person, const uint8_t* rgb) const;

private:
    std::array<std::vector<double>, 2> counts_;
    std::array<double, 2> total_{};
};

// The same about each place of one picture: cells of the picture and of colours, smoothed along all
// of their five axes.
class PlaceColours {
public:
    // cell: pixels. share has the rectangle's size.
    PlaceColours(const Image& rgb, const Rect& rect, const std::vector<float>& share, int cell);

    // log of how much likelier the person has this colour here than the background has; where
    // little was seen about here, what the clip says counts.
    float favour(int x, int y, const uint8_t* rgb, const ClipColours& clip) const;

private:
    static constexpr int kLevels = 12;  // per channel
    size_t at(int column, int row) const;

    Rect rect_;
    int cell_ = 1, columns_ = 0, rows_ = 0;
    std::array<std::vector<float>, 2> counts_;  // [rows][columns][kLevels³]
    std::array<std::vector<float>, 2> totals_;  // [rows][columns]
};

// Log of how much likelier a colour is not that of what is behind, shadows that fall on it allowed
// for; values of 255, and the variance of the latter's.
float notBehind(const std::array<double, 3>& here, const std::array<double, 3>& behind,
                double variance);

// What is behind the person, pixel by pixel, as far as some picture showed it; exposures that drift
// are brought to the first picture's.
class StillBackground {
public:
    // Pictures of one size. Pixels with a share of less than a twentieth are background.
    void add(const Image& rgb, const std::vector<float>& share);
    // A picture of the empty scene instead, of that size.
    void set(const Image& plate);

    // Whether the camera stood still, so that places mean anything.
    bool still() const;
    bool given() const { return given_; }
    // How far this picture is from the background where nobody is, values of 255: the median.
    double distance(const Image& rgb, const std::vector<float>& share) const;

    // [rect]: log of how much likelier each pixel is not the background of its place; 0 where that
    // was never seen.
    std::vector<float> favour(const Image& rgb, const std::vector<float>& share,
                              const Rect& rect) const;

private:
    struct Pixel {
        std::array<float, 3> sum{}, squares{};
        float count = 0;
    };
    // Factors that bring the picture's exposure to the background's.
    std::array<double, 3> gains(const Image& rgb, const std::vector<float>& share) const;

    int width_ = 0, height_ = 0;
    bool given_ = false;
    std::vector<Pixel> pixels_;
};

}  // namespace doppel
