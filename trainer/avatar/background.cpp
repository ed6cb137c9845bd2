#include "trainer/avatar/background.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/files/byte_store.h"

namespace doppel {

namespace {

// Pixels this close to the mask still show the person's rim.
constexpr int kRim = 3;
// A median of this many frames, evenly taken, is as good as one of all.
constexpr size_t kMedianFrames = 31;
// Parts in which their pixels are looked at, and memory for those that wait.
constexpr size_t kBands = 16;
constexpr uint64_t kMemory = uint64_t{256} << 20;

}  // namespace

void fillHoles(std::vector<float>& rgb, std::vector<uint8_t>& known, size_t width, size_t height) {
    if (std::ranges::all_of(known, [](uint8_t k) { return k != 0; })) return;
    if (width == 1 && height == 1) {
        std::fill(rgb.begin(), rgb.end(), 0.5f);  // nothing is known anywhere: grey
        return;
    }
    size_t halfWidth = (width + 1) / 2, halfHeight = (height + 1) / 2;
    std::vector<float> half(halfWidth * halfHeight * 3);
    std::vector<uint8_t> halfKnown(halfWidth * halfHeight);
    for (size_t y = 0; y < halfHeight; ++y)
        for (size_t x = 0; x < halfWidth; ++x) {
            float sum[3] = {0, 0, 0};
            float count = 0;
            for (size_t fy = 2 * y; fy < std::min(2 * y + 2, height); ++fy)
                for (size_t fx = 2 * x; fx < std::min(2 * x + 2, width); ++fx) {
                    size_t pixel = fy * width + fx;
                    if (!known[pixel]) continue;
                    count += 1;
                    for (size_t c = 0; c < 3; ++c) sum[c] += rgb[3 * pixel + c];
                }
            if (count == 0) continue;
            halfKnown[y * halfWidth + x] = 1;
            for (size_t c = 0; c < 3; ++c) half[3 * (y * halfWidth + x) + c] = sum[c] / count;
        }
    fillHoles(half, halfKnown, halfWidth, halfHeight);
    // Bilinear: of the half that a pixel lies in and its neighbour on the pixel's side, 3 to 1.
    auto sides = [](size_t x, size_t end) {
        const size_t own = x / 2, other = x % 2 == 1 ? own + 1 : own == 0 ? 0 : own - 1;
        return std::pair(own, std::min(other, end - 1));
    };
    for (size_t y = 0; y < height; ++y)
        for (size_t x = 0; x < width; ++x) {
            if (known[y * width + x]) continue;
            const auto [x0, x1] = sides(x, halfWidth);
            const auto [y0, y1] = sides(y, halfHeight);
            auto at = [&](size_t u, size_t v, size_t c) {
                return half[3 * (v * halfWidth + u) + c];
            };
            for (size_t c = 0; c < 3; ++c)
                rgb[3 * (y * width + x) + c] =
                    (9 * at(x0, y0, c) + 3 * at(x1, y0, c) + 3 * at(x0, y1, c) + at(x1, y1, c)) /
                    16;
        }
}

std::vector<uint8_t> dilateMask(const std::vector<uint8_t>& mask, int width, int height,
                                int radius) {
    // Along rows, then along columns: the maximum over a square.
    auto w = static_cast<size_t>(width), h = static_cast<size_t>(height);
    auto r = static_cast<size_t>(radius);
    std::vector<uint8_t> rows(mask.size()), result(mask.size());
    for (size_t y = 0; y < h; ++y)
        for (size_t x = 0; x < w; ++x)
            for (size_t k = x >= r ? x - r : 0; k <= std::min(x + r, w - 1); ++k)
                rows[y * w + x] = std::max(rows[y * w + x], mask[y * w + k]);
    for (size_t y = 0; y < h; ++y)
        for (size_t k = y >= r ? y - r : 0; k <= std::min(y + r, h - 1); ++k)
            for (size_t x = 0; x < w; ++x)
                result[y * w + x] = std::max(result[y * w + x], rows[k * w + x]);
    return result;
}

std::vector<float> composite(const std::vector<float>& rgb, const std::vector<uint8_t>& mask,
                             const std::vector<float>& background) {
    CHECK(rgb.size() == background.size() && rgb.size() == 3 * mask.size(),
          "a render and its background have the same size");
    std::vector<float> result(rgb.size());
    for (size_t i = 0; i < rgb.size(); ++i)
        result[i] = rgb[i] + (1 - static_cast<float>(mask[i / 3]) / 255.0f) * background[i];
    return result;
}

BackgroundPlate::BackgroundPlate(const Capture& capture, FrameCache& frames, Ranks* ranks) {
    capture.requireMasks();
    width_ = capture.frames.at(0).camera.width;
    height_ = capture.frames.at(0).camera.height;
    const auto w = static_cast<size_t>(width_), h = static_cast<size_t>(height_);
    const size_t count = std::min(capture.size(), kMedianFrames);
    const auto frameOf = [&](size_t k) { return k * capture.size() / count; };
    for (size_t k = 0; k < count; ++k) {
        const Frame& frame = capture.frames[frameOf(k)];
        if (frame.camera.width != width_ || frame.camera.height != height_)
            throwInput(
                "{}: frame {} is {}×{}, the first is {}×{}; frames of one size are needed "
                "for a background",
                capture.folder.string(), frame.name, frame.camera.width, frame.camera.height,
                width_, height_);
    }
    // A rank decodes its frames, hands each rank some rows of them, and finds the median of its own
    // rows of all frames, some at a time: of 4K all of them would be a GB. Pixels are four bytes:
    // the colour, and whether it is the scene's.
    const auto size = static_cast<size_t>(sizeOf(ranks)), own = static_cast<size_t>(rankOf(ranks));
    const size_t rows = (h + size - 1) / size, strip = rows * w * 4;
    const size_t band = std::max<size_t>(1, rows / kBands) * w * 4;
    const auto bytesOf = [&](size_t from) { return std::min(band, strip - from); };
    ByteStore strips(kMemory);
    const auto put = [&](std::span<const uint8_t> pixels) {
        for (size_t from = 0; from < strip; from += band)
            strips.add(pixels.subspan(from, bytesOf(from)));
    };
    inParallel((count + size - 1) / size,
               [&](size_t turn) {
                   std::vector<uint8_t> pixels(strip * size);
                   if (turn * size + own >= count) return pixels;
                   const auto picture = frames.load(frameOf(turn * size + own));
                   const std::vector<uint8_t> person =
                       dilateMask(picture->mask, width_, height_, kRim);
                   for (size_t i = 0; i < person.size(); ++i) {
                       std::copy_n(&picture->rgb[3 * i], 3, &pixels[4 * i]);
                       pixels[4 * i + 3] = person[i] == 0;
                   }
                   return pixels;
               },
               [&](size_t turn, const std::vector<uint8_t>& pixels) {
                   if (size == 1) {
                       put(pixels);
                       return;
                   }
                   std::vector<uint8_t> theirs(strip * size);
                   ranks->allToAll(std::as_bytes(std::span(pixels)).data(),
                                   std::as_writable_bytes(std::span(theirs)).data(), strip);
                   for (size_t rank = 0; rank < size && turn * size + rank < count; ++rank)
                       put(std::span<const uint8_t>(theirs).subspan(rank * strip, strip));
               });
    std::vector<uint8_t> medians(strip), values;
    const size_t bands = (strip + band - 1) / band;
    for (size_t k = 0; k < bands; ++k) {
        std::vector<std::vector<uint8_t>> pixels;
        for (size_t f = 0; f < count; ++f) pixels.push_back(strips.read(f * bands + k));
        for (size_t at = 0; at < bytesOf(k * band); at += 4)
            for (size_t c = 0; c < 3; ++c) {
                values.clear();
                for (const std::vector<uint8_t>& frame : pixels)
                    if (frame[at + 3]) values.push_back(frame[at + c]);
                if (values.empty()) continue;
                auto middle = values.begin() + static_cast<long>(values.size() / 2);
                std::nth_element(values.begin(), middle, values.end());
                medians[k * band + at + c] = *middle;
                medians[k * band + at + 3] = 1;
            }
    }
    std::vector<uint8_t> all(strip * size);
    if (size > 1)
        ranks->allGather(std::as_bytes(std::span(medians)).data(),
                         std::as_writable_bytes(std::span(all)).data(), strip);
    else
        all = std::move(medians);
    plate_.resize(3 * w * h);
    std::vector<uint8_t> known(w * h);
    for (size_t i = 0; i < known.size(); ++i) {
        known[i] = all[4 * i + 3];
        for (size_t c = 0; known[i] && c < 3; ++c)
            plate_[3 * i + c] = static_cast<float>(all[4 * i + c]) / 255.0f;
    }
    fillHoles(plate_, known, w, h);
}

std::vector<float> BackgroundPlate::behind(const Picture& picture) const {
    std::vector<float> result = plate_;
    std::vector<uint8_t> person = dilateMask(picture.mask, width_, height_, kRim);
    for (size_t i = 0; i < result.size(); ++i)
        if (!person[i / 3]) result[i] = static_cast<float>(picture.rgb[i]) / 255.0f;
    return result;
}

void BackgroundPlate::removePerson(Picture& picture) const {
    const std::vector<uint8_t> person = dilateMask(picture.mask, width_, height_, kRim);
    for (size_t i = 0; i < plate_.size(); ++i)
        if (person[i / 3])
            picture.rgb[i] =
                static_cast<uint8_t>(std::lround(255 * std::clamp(plate_[i], 0.0f, 1.0f)));
}

BackgroundPlates::BackgroundPlates(const Capture& capture, FrameCache& frames, Ranks* ranks) {
    std::map<std::pair<int, int>, std::vector<size_t>> sizes;
    for (size_t i = 0; i < capture.size(); ++i) {
        const Camera& camera = capture.frames[i].camera;
        sizes[{camera.width, camera.height}].push_back(i);
    }
    for (const auto& [size, members] : sizes) {
        if (sizes.size() == 1) {
            bySize_.emplace(size, BackgroundPlate(capture, frames, ranks));
            continue;
        }
        const Capture part = capture.subset(members);
        FrameCache cache(part);
        bySize_.emplace(size, BackgroundPlate(part, cache, ranks));
    }
}

void BackgroundPlates::removePerson(Picture& picture) const {
    bySize_.at({picture.width, picture.height}).removePerson(picture);
}

}  // namespace doppel
