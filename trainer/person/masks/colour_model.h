// Whose colour is it, the person's or the background's? Histograms of both: over a whole clip,
// about each place of one picture, and the background of each place where the camera stands still.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/io/image.h"
#include "trainer/person/masks/clip_view.h"

namespace doppel {

// A part of a picture.
struct Rect {
    int left = 0, top = 0, right = 0, bottom = 0;
    int width() const { return right - left; }
    int height() const { return bottom - top; }
    bool empty() const { return right <= left || bottom <= top; }
};

// Over all pictures of a clip: how often colours are those of each part of the person and those of
// the background. What one picture's network takes for the person by mistake, as a wall between an
// arm and a trunk, is something else in others; hair and shoes are the same in all. Its size does
// not depend on the clip's.
class ClipColours {
public:
    ClipColours();

    // The surer the network is of a pixel, the more it counts: of a forearm that is six pixels wide
    // it is not sure at all. Rims of feet count little, for there is the same ground in all frames.
    void add(const ClipView& view);
    // Before its shares are asked, after the last add().
    void finish();

    // Shares of the pixels of the background, and of a part of the person, with about this colour.
    // Where little was seen of the part, what the whole person says counts.
    double ofBackground(const uint8_t* rgb) const { return density(kBackground, rgb); }
    double ofPart(size_t part, const uint8_t* rgb) const;

private:
    // Of a part, then the background and the whole person.
    static constexpr size_t kBackground = kPicturedParts, kPerson = kBackground + 1;
    double density(size_t whose, const uint8_t* rgb) const;

    std::array<std::vector<double>, kPerson + 1> counts_;
    std::array<double, kPerson + 1> total_{};
};

// The background's about each place of one picture: cells of the picture and of colours, smoothed
// along all of their five axes.
class PlaceColours {
public:
    // cell: pixels. share has the rectangle's size.
    PlaceColours(const Image& rgb, const Rect& rect, const std::vector<float>& share, int cell);

    // log of how much likelier the part of the person that is near has this colour, by the clip,
    // than the background has here; where little of that was seen, what the clip says counts.
    float favour(int x, int y, const uint8_t* rgb, const ClipColours& clip, size_t part) const;

private:
    static constexpr int kLevels = 12;  // per channel
    size_t at(int column, int row) const;

    Rect rect_;
    int cell_ = 1, columns_ = 0, rows_ = 0;
    std::vector<float> counts_;  // [rows][columns][kLevels³]
    std::vector<float> totals_;  // [rows][columns]
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
