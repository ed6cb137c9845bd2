#include "trainer/avatar/background.h"

#include <algorithm>

#include "engine/error.h"

namespace doppel {

namespace {

// Pixels this close to the mask still show the person's rim.
constexpr int kRim = 3;
// A median of this many frames, evenly taken, is as good as one of all.
constexpr size_t kMedianFrames = 31;

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

BackgroundPlate::BackgroundPlate(const Capture& capture, FrameCache& frames) {
    capture.requireMasks();
    width_ = capture.frames.at(0).camera.width;
    height_ = capture.frames.at(0).camera.height;
    size_t pixels = static_cast<size_t>(width_) * static_cast<size_t>(height_);
    size_t count = std::min(capture.size(), kMedianFrames);

    std::vector<std::shared_ptr<const Picture>> pictures;
    std::vector<std::vector<uint8_t>> masks;
    for (size_t i = 0; i < count; ++i) {
        size_t frame = i * capture.size() / count;
        const Camera& camera = capture.frames[frame].camera;
        if (camera.width != width_ || camera.height != height_)
            throwInput(
                "{}: frame {} is {}×{}, the first is {}×{}; frames of one size are needed "
                "for a background",
                capture.folder.string(), capture.frames[frame].name, camera.width, camera.height,
                width_, height_);
        pictures.push_back(frames.load(frame));
        masks.push_back(dilateMask(pictures.back()->mask, width_, height_, kRim));
    }
    plate_.resize(pixels * 3);
    std::vector<uint8_t> known(pixels);
    std::vector<uint8_t> values;
    for (size_t pixel = 0; pixel < pixels; ++pixel)
        for (size_t c = 0; c < 3; ++c) {
            values.clear();
            for (size_t i = 0; i < count; ++i)
                if (!masks[i][pixel]) values.push_back(pictures[i]->rgb[3 * pixel + c]);
            if (values.empty()) continue;
            auto middle = values.begin() + static_cast<long>(values.size() / 2);
            std::nth_element(values.begin(), middle, values.end());
            plate_[3 * pixel + c] = static_cast<float>(*middle) / 255.0f;
            known[pixel] = 1;
        }
    fillHoles(plate_, known, static_cast<size_t>(width_), static_cast<size_t>(height_));
}

std::vector<float> BackgroundPlate::behind(const Picture& picture) const {
    std::vector<float> result = plate_;
    std::vector<uint8_t> person = dilateMask(picture.mask, width_, height_, kRim);
    for (size_t i = 0; i < result.size(); ++i)
        if (!person[i / 3]) result[i] = static_cast<float>(picture.rgb[i]) / 255.0f;
    return result;
}

BackgroundPlates::BackgroundPlates(const Capture& capture, FrameCache& frames) {
    std::map<std::pair<int, int>, std::vector<size_t>> sizes;
    for (size_t i = 0; i < capture.size(); ++i) {
        const Camera& camera = capture.frames[i].camera;
        sizes[{camera.width, camera.height}].push_back(i);
    }
    for (const auto& [size, members] : sizes) {
        if (sizes.size() == 1) {
            bySize_.emplace(size, BackgroundPlate(capture, frames));
            continue;
        }
        const Capture part = capture.subset(members);
        FrameCache cache(part);
        bySize_.emplace(size, BackgroundPlate(part, cache));
    }
}

std::vector<float> BackgroundPlates::behind(const Picture& picture) const {
    return bySize_.at({picture.width, picture.height}).behind(picture);
}

}  // namespace doppel
