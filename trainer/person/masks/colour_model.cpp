#include "trainer/person/masks/colour_model.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr float kSurelyNot = .05f;  // a share
constexpr double kSureness = 8;     // power of a share: what the person's pixels count
constexpr double kFootRim = .01;    // of the square's side

// ---- histograms of a clip -----------------------------------------------------------------------

constexpr size_t kSteps = 32;  // per channel

size_t stepOf(uint8_t value) { return value * kSteps / 256; }

size_t binOf(const uint8_t* rgb) {
    return (stepOf(rgb[0]) * kSteps + stepOf(rgb[1])) * kSteps + stepOf(rgb[2]);
}

// [1 2 1] / 4 along an axis of `length`, whose elements are `stride` apart.
template <typename Value>
void smoothAxis(std::vector<Value>& values, size_t length, size_t stride) {
    std::vector<Value> line(length);
    for (size_t start = 0; start < values.size(); ++start) {
        if (start / stride % length != 0) continue;
        for (size_t i = 0; i < length; ++i) line[i] = values[start + i * stride];
        for (size_t i = 0; i < length; ++i) {
            const Value before = line[i > 0 ? i - 1 : i], after = line[i + 1 < length ? i + 1 : i];
            values[start + i * stride] = (before + 2 * line[i] + after) / 4;
        }
    }
}

}  // namespace

ClipColours::ClipColours() {
    for (auto& counts : counts_) counts.assign(kSteps * kSteps * kSteps, 0);
}

void ClipColours::add(const ClipView& view) {
    const auto& [rgb, share, part, side] = view;
    CHECK(rgb.channels == 3 && 3 * share.size() == rgb.data.size() && part.size() == share.size(),
          "share and part have the picture's size");
    const int width = rgb.width, height = rgb.height, rim = int(std::lround(kFootRim * side));
    const auto at = [&](int x, int y) {
        return share[size_t(std::clamp(y, 0, height - 1)) * size_t(width) +
                     size_t(std::clamp(x, 0, width - 1))];
    };
    // Far more pixels than bins: one of two along each axis tells as much.
    for (int y = 0; y < height; y += 2)
        for (int x = 0; x < width; x += 2) {
            float sure = at(x, y);
            size_t whose = part[size_t(y) * size_t(width) + size_t(x)];
            double weight = 1;
            if (sure <= kSurelyNot) {
                whose = kBackground;
            } else {
                if (whose == size_t(PicturedPart::Foot))
                    sure = std::min(
                        {sure, at(x - rim, y), at(x + rim, y), at(x, y - rim), at(x, y + rim)});
                weight = std::pow(double(sure), kSureness);
            }
            counts_[whose][binOf(rgb.pixel(x, y))] += weight;
            total_[whose] += weight;
        }
}

void ClipColours::finish() {
    for (size_t part = 0; part < kPicturedParts; ++part) {
        std::ranges::transform(counts_[kPerson], counts_[part], counts_[kPerson].begin(),
                               std::plus());
        total_[kPerson] += total_[part];
    }
    for (auto& counts : counts_)
        for (size_t stride : {size_t(1), kSteps, kSteps * kSteps})
            smoothAxis(counts, kSteps, stride);
}

double ClipColours::density(size_t whose, const uint8_t* rgb) const {
    return total_[whose] > 0 ? counts_[whose][binOf(rgb)] / total_[whose] : 0;
}

double ClipColours::ofPart(size_t part, const uint8_t* rgb) const {
    constexpr double kLittle = 60;  // pixels that the whole person is worth
    return (counts_[part][binOf(rgb)] + kLittle * density(kPerson, rgb)) / (total_[part] + kLittle);
}

// ---- about each place ---------------------------------------------------------------------------

namespace {

// A number of cells and how far into the next: linear interpolation between cells' centres.
struct Between {
    int low = 0, high = 0;
    float share = 0;  // of high
};

Between between(double position, int count) {
    const double at = std::clamp(position - .5, 0., double(count - 1));
    const int low = int(at);
    return {low, std::min(low + 1, count - 1), float(at - low)};
}

}  // namespace

PlaceColours::PlaceColours(const Image& rgb, const Rect& rect, const std::vector<float>& share,
                           int cell)
    : rect_(rect), cell_(cell) {
    CHECK(share.size() == size_t(rect.width()) * size_t(rect.height()) && cell > 0,
          "a share has the rectangle's size");
    columns_ = (rect.width() + cell - 1) / cell;
    rows_ = (rect.height() + cell - 1) / cell;
    constexpr size_t kBins = size_t(kLevels) * kLevels * kLevels;
    const size_t cells = size_t(columns_) * size_t(rows_);
    counts_.assign(cells * kBins, 0);
    totals_.assign(cells, 0);
    const auto level = [](uint8_t value) { return size_t(value) * kLevels / 256; };
    for (int y = 0; y < rect.height(); ++y)
        for (int x = 0; x < rect.width(); ++x) {
            // The surer, the more it counts; what is in doubt does not.
            const float weight = .8f - 2 * share[size_t(y) * size_t(rect.width()) + size_t(x)];
            if (weight <= 0) continue;
            const uint8_t* p = rgb.pixel(rect.left + x, rect.top + y);
            const size_t bin = (level(p[0]) * kLevels + level(p[1])) * kLevels + level(p[2]);
            counts_[at(x / cell, y / cell) * kBins + bin] += weight;
        }
    const auto levels = size_t(kLevels);
    for (size_t stride : {size_t(1), levels, levels * levels}) smoothAxis(counts_, levels, stride);
    smoothAxis(counts_, size_t(columns_), kBins);
    smoothAxis(counts_, size_t(rows_), kBins * size_t(columns_));
    for (size_t i = 0; i < cells; ++i)
        for (size_t k = 0; k < kBins; ++k) totals_[i] += counts_[i * kBins + k];
}

size_t PlaceColours::at(int column, int row) const {
    return size_t(row) * size_t(columns_) + size_t(column);
}

float PlaceColours::favour(int x, int y, const uint8_t* rgb, const ClipColours& clip,
                           size_t part) const {
    constexpr size_t kBins = size_t(kLevels) * kLevels * kLevels;
    constexpr double kPrior = 60;    // pixels that the clip's histogram is worth
    constexpr double kFloor = 2e-4;  // of all colours there are, any may come up
    // Bins of the clip's histogram are smaller.
    constexpr double kRatio = double(kSteps * kSteps * kSteps) / double(kBins);
    const Between u = between((x - rect_.left + .5) / cell_, columns_),
                  v = between((y - rect_.top + .5) / cell_, rows_);
    std::array<Between, 3> c;
    for (size_t k = 0; k < 3; ++k) c[k] = between((rgb[k] + .5) * kLevels / 256, kLevels);
    double count = 0, total = 0;
    for (int place = 0; place < 4; ++place) {
        const float weight =
            (place & 1 ? u.share : 1 - u.share) * (place & 2 ? v.share : 1 - v.share);
        if (weight == 0) continue;
        const size_t cell = at(place & 1 ? u.high : u.low, place & 2 ? v.high : v.low);
        total += double(weight * totals_[cell]);
        const float* counts = &counts_[cell * kBins];
        for (int corner = 0; corner < 8; ++corner) {
            float w = weight;
            size_t bin = 0;
            for (size_t k = 0; k < 3; ++k) {
                const bool high = corner >> k & 1;
                w *= high ? c[k].share : 1 - c[k].share;
                bin = bin * kLevels + size_t(high ? c[k].high : c[k].low);
            }
            count += double(w * counts[bin]);
        }
    }
    const double person = kRatio * clip.ofPart(part, rgb) + kFloor,
                 background =
                     (count + kPrior * kRatio * clip.ofBackground(rgb)) / (total + kPrior) + kFloor;
    return float(std::log(person / background));
}

// ---- a camera that stands still -----------------------------------------------------------------

namespace {

constexpr float kEnough = 3;       // pictures that showed a place
constexpr double kNoise = 3;       // values of 255: what sensors and codecs add at least
constexpr double kStillNoise = 7;  // more than that is motion

}  // namespace

float notBehind(const std::array<double, 3>& here, const std::array<double, 3>& behind,
                double variance) {
    double along = 0, length = 0;
    for (size_t c = 0; c < 3; ++c) {
        along += here[c] * behind[c];
        length += behind[c] * behind[c];
    }
    // A shadow makes the background darker, and leaves its hue.
    const double shade = std::clamp(along / std::max(length, 1.), .3, 1.05);
    double distance = 0, shaded = 0;
    for (size_t c = 0; c < 3; ++c) {
        const double d = here[c] - behind[c], e = here[c] - shade * behind[c];
        distance += d * d / variance;
        shaded += e * e / variance;
    }
    distance = std::min(distance, shaded + 6 + 10 * (1 - shade));
    return float(std::clamp(.5 * (distance - 12), -4., 5.));
}

std::array<double, 3> StillBackground::gains(const Image& rgb,
                                             const std::vector<float>& share) const {
    std::array<double, 3> here{}, there{};
    for (size_t i = 0; i < pixels_.size(); i += 3) {
        const Pixel& pixel = pixels_[i];
        if (share[i] > kSurelyNot || pixel.count == 0) continue;
        for (size_t c = 0; c < 3; ++c) {
            const uint8_t value = rgb.data[3 * i + c];
            if (value > 250) continue;  // clipped
            here[c] += value;
            there[c] += double(pixel.sum[c] / pixel.count);
        }
    }
    std::array<double, 3> gains{1, 1, 1};
    for (size_t c = 0; c < 3; ++c)
        if (here[c] > 0 && there[c] > 0) gains[c] = std::clamp(there[c] / here[c], .5, 2.);
    return gains;
}

void StillBackground::add(const Image& rgb, const std::vector<float>& share) {
    if (given_) return;
    if (pixels_.empty()) {
        width_ = rgb.width, height_ = rgb.height;
        pixels_.resize(share.size());
    }
    CHECK(rgb.width == width_ && rgb.height == height_, "a clip's pictures are of one size");
    const auto gain = gains(rgb, share);
    for (size_t i = 0; i < pixels_.size(); ++i) {
        if (share[i] > kSurelyNot) continue;
        Pixel& pixel = pixels_[i];
        for (size_t c = 0; c < 3; ++c) {
            const auto value = float(gain[c] * rgb.data[3 * i + c]);
            pixel.sum[c] += value;
            pixel.squares[c] += value * value;
        }
        ++pixel.count;
    }
}

void StillBackground::set(const Image& plate) {
    given_ = true;
    width_ = plate.width, height_ = plate.height;
    pixels_.assign(size_t(width_) * size_t(height_), {});
    for (int y = 0; y < height_; ++y)
        for (int x = 0; x < width_; ++x) {
            Pixel& pixel = pixels_[size_t(y) * size_t(width_) + size_t(x)];
            pixel.count = kEnough;
            for (size_t c = 0; c < 3; ++c) {
                // Edges come and go with what codecs and lenses make of them: a third of a pixel.
                const float value = plate.pixel(x, y)[c],
                            across = plate.pixel(std::min(x + 1, width_ - 1), y)[c] -
                                     plate.pixel(std::max(x - 1, 0), y)[c],
                            down = plate.pixel(x, std::min(y + 1, height_ - 1))[c] -
                                   plate.pixel(x, std::max(y - 1, 0))[c];
                const float spread = (across * across + down * down) / 36;
                pixel.sum[c] = kEnough * value;
                pixel.squares[c] = kEnough * (value * value + spread);
            }
        }
}

bool StillBackground::still() const {
    if (given_) return true;
    std::vector<double> spread;
    for (size_t i = 0; i < pixels_.size(); i += 5) {
        const Pixel& pixel = pixels_[i];
        if (pixel.count < kEnough) continue;
        double variance = 0;
        for (size_t c = 0; c < 3; ++c) {
            const double mean = double(pixel.sum[c] / pixel.count);
            variance += double(pixel.squares[c] / pixel.count) - mean * mean;
        }
        spread.push_back(std::sqrt(std::max(0., variance / 3)));
    }
    if (spread.size() < 100) return false;
    // Walls of one colour tell nothing: what has edges has to rest too.
    const auto at = spread.begin() + std::ptrdiff_t(spread.size() * 17 / 20);
    std::nth_element(spread.begin(), at, spread.end());
    return *at < kStillNoise;
}

double StillBackground::distance(const Image& rgb, const std::vector<float>& share) const {
    const auto gain = gains(rgb, share);
    std::vector<double> apart;
    for (size_t i = 0; i < pixels_.size(); i += 3) {
        const Pixel& pixel = pixels_[i];
        if (share[i] > kSurelyNot || pixel.count < kEnough) continue;
        double sum = 0;
        for (size_t c = 0; c < 3; ++c)
            sum += std::abs(gain[c] * rgb.data[3 * i + c] - double(pixel.sum[c] / pixel.count));
        apart.push_back(sum / 3);
    }
    if (apart.empty()) return 0;
    const auto middle = apart.begin() + std::ptrdiff_t(apart.size() / 2);
    std::nth_element(apart.begin(), middle, apart.end());
    return *middle;
}

std::vector<float> StillBackground::favour(const Image& rgb, const std::vector<float>& share,
                                           const Rect& rect) const {
    const auto gain = gains(rgb, share);
    std::vector<float> favour(size_t(rect.width()) * size_t(rect.height()));
    for (int y = rect.top; y < rect.bottom; ++y)
        for (int x = rect.left; x < rect.right; ++x) {
            const Pixel& pixel = pixels_[size_t(y) * size_t(width_) + size_t(x)];
            if (pixel.count < kEnough) continue;
            std::array<double, 3> here, there;
            double variance = 0;
            for (size_t c = 0; c < 3; ++c) {
                here[c] = gain[c] * rgb.pixel(x, y)[c];
                there[c] = double(pixel.sum[c] / pixel.count);
                variance += double(pixel.squares[c] / pixel.count) - there[c] * there[c];
            }
            favour[size_t(y - rect.top) * size_t(rect.width()) + size_t(x - rect.left)] =
                notBehind(here, there, std::max(variance / 3, kNoise * kNoise));
        }
    return favour;
}

}  // namespace doppel
