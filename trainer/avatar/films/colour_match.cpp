#include "trainer/avatar/films/colour_match.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr float kShare = .1f;  // of each further picture in what is found
constexpr double kLeast = 1e-3;

// Sums of colours, weighted.
struct Colours {
    double weight = 0, luma = 0, lumaSquare = 0;
    std::array<double, 3> sum{};

    void add(const float* rgb, double w) {
        const double y = .2126 * rgb[0] + .7152 * rgb[1] + .0722 * rgb[2];
        weight += w, luma += w * y, lumaSquare += w * y * y;
        for (size_t c = 0; c < 3; ++c) sum[c] += w * rgb[c];
    }
    double mean() const { return luma / weight; }
    double deviation() const {
        return std::sqrt(std::max(lumaSquare / weight - mean() * mean(), 0.));
    }
};

// A part of the way, and no farther than that.
float towards(double from, double to, double part, double most) {
    const double ratio = std::pow((to + kLeast) / (from + kLeast), part);
    return static_cast<float>(std::clamp(ratio, 1 / most, most));
}

}  // namespace

void ColourMatch::apply(Drawing& drawing, const std::vector<float>& background) {
    CHECK(background.size() == drawing.rgb.size(), "a background has the size of its picture");
    const auto width = static_cast<size_t>(drawing.width);
    size_t left = width, right = 0, top = drawing.mask.size(), bottom = 0;
    Colours avatar, around;
    for (size_t i = 0; i < drawing.mask.size(); ++i) {
        if (drawing.mask[i] == 0) continue;
        left = std::min(left, i % width), right = std::max(right, i % width);
        top = std::min(top, i / width), bottom = std::max(bottom, i / width);
        const double cover = drawing.mask[i] / 255.;
        std::array<float, 3> colour;
        for (size_t c = 0; c < 3; ++c)
            colour[c] = static_cast<float>(drawing.rgb[3 * i + c] / cover);
        avatar.add(colour.data(), cover);
    }
    if (avatar.weight == 0) return;
    const size_t w = right - left + 1, h = bottom - top + 1;
    for (size_t i = 0; i < drawing.mask.size(); ++i) {
        const size_t x = i % width, y = i / width;
        if (drawing.mask[i] == 0 && x + w >= left && x <= right + w && y + h >= top &&
            y <= bottom + h)
            around.add(&background[3 * i], 1);
    }
    if (around.weight > 0) {
        const float share = begun_ ? kShare : 1;
        const float bright = towards(avatar.mean(), around.mean(), .3, 1.25);
        for (size_t c = 0; c < 3; ++c) {
            const float tint = towards(around.mean(), around.sum[c] / around.weight, .5, 1.15);
            gain_[c] += share * (bright * tint - gain_[c]);
        }
        contrast_ +=
            share * (towards(avatar.deviation(), around.deviation(), .2, 1.15) - contrast_);
        begun_ = true;
    }
    const auto middle = static_cast<float>(avatar.mean());
    for (size_t i = 0; i < drawing.mask.size(); ++i) {
        const float cover = static_cast<float>(drawing.mask[i]) / 255.0f;
        for (size_t c = 0; c < 3; ++c) {
            float& value = drawing.rgb[3 * i + c];
            // Of colours that are weighted by the cover, and so is the middle.
            const float spread = middle * cover + contrast_ * (value - middle * cover);
            value = std::clamp(gain_[c] * spread, 0.0f, cover);
        }
    }
}

}  // namespace doppel
