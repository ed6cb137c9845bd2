#include "trainer/stages/rim.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>

#include "trainer/avatar/background.h"
#include "trainer/import/chroma_key.h"

namespace doppel {

namespace {

constexpr size_t kMostFrames = 16;
constexpr int kBeyond = 3;           // pixels from the mask, where nothing of the person is left
constexpr int kBesideReach = 8;      // to the background beside
constexpr int kInsideFrom = 3;       // pixels below the rim, where the inside begins,
constexpr int kInsideTo = 5;         // and where it is no longer the nearest
constexpr double kLeastShare = .03;  // what less there is, shading may be

// Brightness, and blue and red against it.
using Colour = std::array<double, 3>;
Colour colourAt(const std::vector<uint8_t>& rgb, size_t pixel) {
    const double r = rgb[3 * pixel], g = rgb[3 * pixel + 1], b = rgb[3 * pixel + 2];
    const double luma = .299 * r + .587 * g + .114 * b;
    return {luma, b - luma, r - luma};
}

// Means over squares around a pixel of the pixels that are in a set.
class LocalMeans {
public:
    LocalMeans(const Picture& picture, const std::vector<uint8_t>& among)
        : width_(picture.width), height_(picture.height) {
        const auto stride = static_cast<size_t>(width_) + 1;
        sums_.resize(stride * (static_cast<size_t>(height_) + 1));
        for (int y = 0; y < height_; ++y) {
            Sum row{};
            for (int x = 0; x < width_; ++x) {
                const auto at =
                    static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
                if (among[at]) {
                    const Colour colour = colourAt(picture.rgb, at);
                    for (size_t c = 0; c < 3; ++c) row[c] += colour[c];
                    ++row[3];
                }
                const size_t here =
                    (static_cast<size_t>(y) + 1) * stride + static_cast<size_t>(x) + 1;
                for (size_t c = 0; c < 4; ++c) sums_[here][c] = sums_[here - stride][c] + row[c];
            }
        }
    }
    // False where there are fewer than four.
    bool at(int x, int y, int reach, Colour& mean) const {
        const auto stride = static_cast<size_t>(width_) + 1;
        const auto x0 = static_cast<size_t>(std::max(0, x - reach)),
                   y0 = static_cast<size_t>(std::max(0, y - reach)),
                   x1 = static_cast<size_t>(std::min(width_, x + reach + 1)),
                   y1 = static_cast<size_t>(std::min(height_, y + reach + 1));
        Sum sum{};
        for (size_t c = 0; c < 4; ++c)
            sum[c] = sums_[y1 * stride + x1][c] - sums_[y0 * stride + x1][c] -
                     sums_[y1 * stride + x0][c] + sums_[y0 * stride + x0][c];
        if (sum[3] < 3.5) return false;
        for (size_t c = 0; c < 3; ++c) mean[c] = sum[c] / sum[3];
        return true;
    }

private:
    using Sum = std::array<double, 4>;
    int width_, height_;
    std::vector<Sum> sums_;
};

// How many pixels from the outside, up to `most`; 0 is the outside.
std::vector<uint8_t> depthsOf(const Picture& picture, int most) {
    std::vector<uint8_t> outside(picture.mask.size());
    std::ranges::transform(picture.mask, outside.begin(),
                           [](uint8_t m) { return static_cast<uint8_t>(m > 127 ? 0 : 255); });
    std::vector<uint8_t> depths(outside.size());
    for (int d = 0; d < most; ++d) {
        for (size_t i = 0; i < depths.size(); ++i) depths[i] += outside[i] == 0;
        outside = dilateMask(outside, picture.width, picture.height, 1);
    }
    return depths;
}

std::vector<uint8_t> farOutside(const Picture& picture) {
    std::vector<uint8_t> beyond = dilateMask(picture.mask, picture.width, picture.height, kBeyond);
    for (uint8_t& value : beyond) value = value == 0;
    return beyond;
}

}  // namespace

RimProfile measureRim(const Capture& capture, FrameCache& frames, int depth) {
    const auto count = static_cast<size_t>(depth);
    RimProfile rim{std::vector<double>(count), std::vector<double>(count)};
    if (depth == 0) return rim;
    std::vector<std::array<double, 4>> sums(count);  // luma and chroma, each over what it could be
    const size_t views = std::min(capture.size(), kMostFrames);
    std::vector<std::shared_ptr<const Picture>> pictures;
    for (size_t k = 0; k < views; ++k) pictures.push_back(frames.load(k * capture.size() / views));
    const auto isOfFirstSize = [&](const std::shared_ptr<const Picture>& picture) {
        return picture->width == pictures[0]->width && picture->height == pictures[0]->height;
    };
    if (!std::ranges::all_of(pictures, isOfFirstSize) || screenOf(pictures).empty()) return rim;
    for (const std::shared_ptr<const Picture>& picture : pictures) {
        const std::vector<uint8_t> depths = depthsOf(*picture, depth + kInsideTo + 1);
        std::vector<uint8_t> inside(depths.size());
        std::ranges::transform(depths, inside.begin(), [&](uint8_t d) {
            return static_cast<uint8_t>(d >= depth + kInsideFrom && d <= depth + kInsideTo);
        });
        const LocalMeans insides(*picture, inside), outsides(*picture, farOutside(*picture));
        const int reach = depth + kInsideTo + 1, w = picture->width;
        for (int y = 0; y < picture->height; ++y)
            for (int x = 0; x < w; ++x) {
                const auto at =
                    static_cast<size_t>(y) * static_cast<size_t>(w) + static_cast<size_t>(x);
                Colour in{}, out{};
                if (depths[at] == 0 || depths[at] > depth || !insides.at(x, y, reach, in) ||
                    !outsides.at(x, y, kBesideReach, out))
                    continue;
                const Colour here = colourAt(picture->rgb, at);
                std::array<double, 4>& sum = sums[depths[at] - size_t{1}];
                for (size_t c = 0; c < 3; ++c) {
                    const size_t part = c == 0 ? 0 : 2;
                    sum[part] += (here[c] - in[c]) * (out[c] - in[c]);
                    sum[part + 1] += (out[c] - in[c]) * (out[c] - in[c]);
                }
            }
    }
    const auto share = [](double mixed, double all) {
        const double value = all > 0 ? mixed / all : 0;
        return value < kLeastShare ? 0 : std::min(value, kMostMixed);
    };
    for (size_t d = 0; d < count; ++d) {
        rim.luma[d] = share(sums[d][0], sums[d][1]);
        rim.chroma[d] = share(sums[d][2], sums[d][3]);
    }
    return rim;
}

std::vector<uint8_t> unmixed(const Picture& picture, const RimProfile& rim) {
    std::vector<uint8_t> rgb = picture.rgb;
    const auto depth = static_cast<int>(rim.luma.size());
    if (depth == 0) return rgb;
    const std::vector<uint8_t> depths = depthsOf(picture, depth + 1);
    const LocalMeans outsides(picture, farOutside(picture));
    for (int y = 0; y < picture.height; ++y)
        for (int x = 0; x < picture.width; ++x) {
            const auto at = static_cast<size_t>(y) * static_cast<size_t>(picture.width) +
                            static_cast<size_t>(x);
            Colour out{};
            if (depths[at] == 0 || depths[at] > depth || !outsides.at(x, y, kBesideReach, out))
                continue;
            Colour own = colourAt(picture.rgb, at);
            for (size_t c = 0; c < 3; ++c) {
                const double share = (c == 0 ? rim.luma : rim.chroma)[depths[at] - size_t{1}];
                own[c] = (own[c] - share * out[c]) / (1 - share);
            }
            const double blue = own[0] + own[1], red = own[0] + own[2],
                         green = (own[0] - .299 * red - .114 * blue) / .587;
            size_t c = 0;
            for (double value : {red, green, blue})
                rgb[3 * at + c++] = static_cast<uint8_t>(std::lround(std::clamp(value, 0., 255.)));
        }
    return rgb;
}

}  // namespace doppel
