#include "trainer/stages/rim.h"

#include <algorithm>
#include <array>

#include "trainer/avatar/background.h"
#include "trainer/import/masks/chroma_key.h"

namespace doppel {

int rimBeforeScreen(const Capture& capture, FrameCache& frames, int rim, Ranks* ranks) {
    constexpr size_t kMostFrames = 16;
    if (rim == 0) return 0;
    const size_t count = std::min(capture.size(), kMostFrames);
    const auto frameOf = [&](size_t k) { return k * capture.size() / count; };
    const auto cameraOf = [&](size_t k) { return capture.frames[frameOf(k)].camera; };
    for (size_t k = 1; k < count; ++k)
        if (cameraOf(k).width != cameraOf(0).width || cameraOf(k).height != cameraOf(0).height)
            return 0;
    std::vector<std::vector<uint8_t>> borders;
    shareWork(
        ranks, count, [&](size_t k) { return borderOf(*frames.load(frameOf(k))); },
        [&](size_t, std::span<const uint8_t> border) {
            borders.emplace_back(border.begin(), border.end());
        },
        false);
    return screenOf(borders).empty() ? 0 : rim;
}

std::vector<uint8_t> withoutRim(const Picture& picture, int rim, int beyond) {
    std::vector<uint8_t> rgb = picture.rgb;
    if (rim == 0) return rgb;
    const int w = picture.width, h = picture.height;
    std::vector<uint8_t> outside(picture.mask.size());
    std::ranges::transform(picture.mask, outside.begin(),
                           [](uint8_t m) { return static_cast<uint8_t>(m > 127 ? 0 : 255); });
    const std::vector<uint8_t> grown = dilateMask(picture.mask, w, h, beyond);
    // How many pixels from the outside, and no further than it matters.
    std::vector<uint8_t> depth(outside.size());
    for (int d = 0; d <= rim; ++d) {
        const std::vector<uint8_t> reached = dilateMask(outside, w, h, d);
        for (size_t i = 0; i < depth.size(); ++i) depth[i] += reached[i] == 0;
    }
    for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) {
            const auto i = static_cast<size_t>(y * w + x);
            if (depth[i] > rim || grown[i] <= 127) continue;
            // No further than to the nearest that is not of the rim: behind two pixels of hair
            // there is a face.
            const int reach = rim + 1 - depth[i] + (depth[i] == 0 ? beyond : 0);
            uint8_t deepest = 0;
            std::array<int, 3> sum{};
            int count = 0;
            for (int v = std::max(0, y - reach); v <= std::min(h - 1, y + reach); ++v)
                for (int u = std::max(0, x - reach); u <= std::min(w - 1, x + reach); ++u) {
                    const auto other = static_cast<size_t>(v * w + u);
                    if (depth[other] < deepest || depth[other] == 0) continue;
                    if (depth[other] > deepest) {
                        deepest = depth[other];
                        sum = {};
                        count = 0;
                    }
                    for (size_t c = 0; c < 3; ++c) sum[c] += picture.rgb[3 * other + c];
                    ++count;
                }
            for (size_t c = 0; deepest > depth[i] && c < 3; ++c)
                rgb[3 * i + c] = static_cast<uint8_t>((sum[c] + count / 2) / count);
        }
    return rgb;
}

}  // namespace doppel
