#include "trainer/eval/picture_figures.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "engine/io/image.h"
#include "trainer/avatar/background.h"
#include "trainer/eval/metrics.h"

namespace doppel {

namespace {

constexpr double kEqualPsnr = 99;
constexpr int kInterior = 3, kShift = 3, kWhiteRows = 540;
// Of gradient magnitudes in [0,1]: GMSD's 170 of 255 squared.
constexpr double kSimilarity = 170.0 / (255.0 * 255.0);

double psnrOf(double mse) {
    return mse > 0 ? std::min(kEqualPsnr, 10 * std::log10(1 / mse)) : kEqualPsnr;
}

// A picture's pixels by number, with what is computed once.
class Comparison {
public:
    explicit Comparison(const PictureFigures& picture)
        : p_(picture), w_(picture.width), h_(picture.height), size_(picture.mask.size()) {
        for (size_t i = 0; i < size_; ++i) {
            inMask_.push_back(p_.mask[i] > 127);
            inRender_.push_back(p_.coverage[i] > 127);
        }
        greyRender_ = grey(p_.rendered), greyFrame_ = grey(p_.frame);
        slopeRender_ = slopes(greyRender_), slopeFrame_ = slopes(greyFrame_);
    }

    Figures figures() const {
        Figures all;
        const std::vector<size_t> maskRim = outline(inMask_), renderRim = outline(inRender_);
        double only = 0;
        for (size_t i = 0; i < size_; ++i) only += double(inMask_[i]) - double(inRender_[i]);
        all.emplace_back("outline_bias", maskRim.empty() ? 0 : only / double(maskRim.size()));
        all.emplace_back("outline_95", distance95(maskRim, renderRim));
        all.emplace_back("psnr_union", psnr([&](size_t i) { return inMask_[i] || inRender_[i]; }));
        const std::vector<uint8_t> interior = eroded(kInterior), near = eroded(1);
        auto isInterior = [&](size_t i) { return interior[i] > 0; };
        all.emplace_back("psnr_interior", psnr(isInterior));
        all.emplace_back("sharpness_interior", sharpness(isInterior));
        all.emplace_back("psnr_white", psnrOnWhite());
        std::vector<double> map;
        for (const PictureRegion& region : p_.regions) {
            if (std::ranges::count(region.pixels, uint8_t{1}) == 0) continue;
            if (map.empty()) map = ssimMap(p_.rendered, p_.frame, w_, h_);
            auto within = [&](size_t i) { return region.pixels[i] != 0; };
            auto shown = [&](size_t i) { return within(i) && (inMask_[i] || inRender_[i]); };
            auto inside = [&](size_t i) { return within(i) && near[i] > 0; };
            auto add = [&](const char* figure, double value) {
                all.emplace_back(std::string(figure) + "_" + region.name, value);
            };
            add("psnr", psnr(shown));
            add("ssim", mean(
                            shown, [&](size_t i) { return map[i]; }, 1));
            add("sharpness", sharpness(inside));
            add("similarity", mean(
                                  inside,
                                  [&](size_t i) {
                                      const double a = slopeRender_[i], b = slopeFrame_[i];
                                      return (2 * a * b + kSimilarity) /
                                             (a * a + b * b + kSimilarity);
                                  },
                                  1));
            add("correlation", correlation(inside));
        }
        return all;
    }

private:
    using Pixels = std::function<bool(size_t)>;

    static std::vector<double> grey(std::span<const float> rgb) {
        std::vector<double> values;
        for (size_t i = 0; i + 2 < rgb.size(); i += 3)
            values.push_back((double{rgb[i]} + double{rgb[i + 1]} + double{rgb[i + 2]}) / 3);
        return values;
    }
    // Magnitudes of central differences.
    std::vector<double> slopes(const std::vector<double>& values) const {
        std::vector<double> result(values.size());
        for (int y = 0; y < h_; ++y)
            for (int x = 0; x < w_; ++x) {
                auto at = [&](int u, int v) {
                    return values[size_t(std::clamp(v, 0, h_ - 1)) * size_t(w_) +
                                  size_t(std::clamp(u, 0, w_ - 1))];
                };
                result[size_t(y) * size_t(w_) + size_t(x)] =
                    std::hypot(at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)) / 2;
            }
        return result;
    }
    double mean(const Pixels& pixels, const std::function<double(size_t)>& value,
                double empty) const {
        double sum = 0;
        int64_t count = 0;
        for (size_t i = 0; i < size_; ++i)
            if (pixels(i)) sum += value(i), ++count;
        return count > 0 ? sum / double(count) : empty;
    }
    double psnr(const Pixels& pixels) const {
        return psnrOf(mean(
            pixels,
            [&](size_t i) {
                double sum = 0;
                for (size_t c = 3 * i; c < 3 * i + 3; ++c)
                    sum += std::pow(double{p_.rendered[c]} - double{p_.frame[c]}, 2);
                return sum / 3;
            },
            0));
    }
    double sharpness(const Pixels& pixels) const {
        const double own = mean(
            pixels, [&](size_t i) { return slopeRender_[i]; }, 0);
        const double theirs = mean(
            pixels, [&](size_t i) { return slopeFrame_[i]; }, 0);
        return theirs > 0 ? own / theirs : 1;
    }
    std::vector<uint8_t> eroded(int radius) const {
        std::vector<uint8_t> outside(size_);
        for (size_t i = 0; i < size_; ++i) outside[i] = inMask_[i] ? 0 : 255;
        std::vector<uint8_t> grown = dilateMask(outside, w_, h_, radius);
        for (uint8_t& value : grown) value = value ? 0 : 255;
        return grown;
    }
    // Pixels inside with a neighbour outside.
    std::vector<size_t> outline(const std::vector<bool>& inside) const {
        std::vector<size_t> rim;
        const auto w = size_t(w_);
        for (size_t i = 0; i < size_; ++i) {
            if (!inside[i]) continue;
            const size_t x = i % w, y = i / w;
            const bool all = x > 0 && inside[i - 1] && x + 1 < w && inside[i + 1] && y > 0 &&
                             inside[i - w] && y + 1 < size_t(h_) && inside[i + w];
            if (!all) rim.push_back(i);
        }
        return rim;
    }
    double distance95(const std::vector<size_t>& a, const std::vector<size_t>& b) const {
        if (a.empty() || b.empty()) return a.empty() && b.empty() ? 0 : std::hypot(w_, h_);
        std::vector<double> distances;
        const auto w = int64_t{w_};
        for (auto [from, to] : {std::pair{&a, &b}, std::pair{&b, &a}})
            for (size_t i : *from) {
                int64_t nearest = INT64_MAX;
                for (size_t j : *to) {
                    const int64_t dx = int64_t(i) % w - int64_t(j) % w;
                    const int64_t dy = int64_t(i) / w - int64_t(j) / w;
                    nearest = std::min(nearest, dx * dx + dy * dy);
                }
                distances.push_back(std::sqrt(double(nearest)));
            }
        const auto place = distances.begin() + long(double(distances.size() - 1) * .95);
        std::ranges::nth_element(distances, place);
        return *place;
    }
    double psnrOnWhite() const {
        Image render(w_, h_, 3), frame(w_, h_, 3);
        for (size_t i = 0; i < size_; ++i)
            for (size_t c = 3 * i; c < 3 * i + 3; ++c) {
                const double rest = 1 - p_.coverage[i] / 255.0;
                render.data[c] =
                    uint8_t(std::lround(255 * std::clamp(double{p_.person[c]} + rest, 0.0, 1.0)));
                const double own = inMask_[i] ? double{p_.frame[c]} : 1;
                frame.data[c] = uint8_t(std::lround(255 * own));
            }
        if (h_ > kWhiteRows) {
            const int width = std::max(1, int(std::lround(double(w_) * kWhiteRows / h_)));
            render = resize(render, width, kWhiteRows);
            frame = resize(frame, width, kWhiteRows);
        }
        double sum = 0;
        for (size_t i = 0; i < render.data.size(); ++i)
            sum += std::pow((int{render.data[i]} - int{frame.data[i]}) / 255.0, 2);
        return psnrOf(sum / double(render.data.size()));
    }
    // Of the render's grey values, shifted, with the frame's.
    double correlation(const Pixels& pixels) const {
        double best = -1;
        for (int dy = -kShift; dy <= kShift; ++dy)
            for (int dx = -kShift; dx <= kShift; ++dx) {
                double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
                for (size_t i = 0; i < size_; ++i) {
                    if (!pixels(i)) continue;
                    const int x = int(i % size_t(w_)) + dx, y = int(i / size_t(w_)) + dy;
                    if (x < 0 || y < 0 || x >= w_ || y >= h_) continue;
                    const double u = greyRender_[size_t(y) * size_t(w_) + size_t(x)];
                    const double v = greyFrame_[i];
                    n += 1, a += u, b += v, aa += u * u, bb += v * v, ab += u * v;
                }
                const double spread = (n * aa - a * a) * (n * bb - b * b);
                if (spread > 0) best = std::max(best, (n * ab - a * b) / std::sqrt(spread));
            }
        return best;
    }

    const PictureFigures& p_;
    int w_, h_;
    size_t size_;
    std::vector<bool> inMask_, inRender_;
    std::vector<double> greyRender_, greyFrame_, slopeRender_, slopeFrame_;
};

}  // namespace

PictureRegion regionOf(std::string name, const PixelRect& rect, int width, int height) {
    PictureRegion region{std::move(name), std::vector<uint8_t>(static_cast<size_t>(width) *
                                                               static_cast<size_t>(height))};
    for (int y = std::max(0, rect.y0); y < std::min(rect.y1, height); ++y)
        for (int x = std::max(0, rect.x0); x < std::min(rect.x1, width); ++x)
            region.pixels[static_cast<size_t>(y) * static_cast<size_t>(width) +
                          static_cast<size_t>(x)] = 1;
    return region;
}

Figures pictureFigures(const PictureFigures& picture) { return Comparison(picture).figures(); }

}  // namespace doppel
