#include "trainer/import/overlay.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/error.h"

namespace doppel {

namespace {

// Colours every pixel inside the mask that is within `thickness` steps of the outside.
void drawOutline(Image& image, std::span<const uint8_t> mask, int thickness,
                 const std::array<uint8_t, 3>& colour) {
    const int w = image.width, h = image.height;
    const auto inside = [&](int x, int y) {
        return x >= 0 && y >= 0 && x < w && y < h && mask[size_t(y) * size_t(w) + size_t(x)] > 0;
    };
    for (int y = 0; y < h; ++y) {
        for (int x = 0; x < w; ++x) {
            if (!inside(x, y)) continue;
            bool edge = false;
            for (int t = 1; t <= thickness && !edge; ++t) {
                edge = !inside(x - t, y) || !inside(x + t, y) || !inside(x, y - t) ||
                       !inside(x, y + t);
            }
            if (edge) std::copy(colour.begin(), colour.end(), image.pixel(x, y));
        }
    }
}

}  // namespace

Image overlayPicture(const Picture& frame, const BodyPicture& body, int longest) {
    constexpr std::array<double, 3> kTint{255, 150, 40};
    constexpr double kOpaque = .55;
    Image image(frame.width, frame.height, 3);
    image.data = frame.rgb;
    CHECK(body.mask.size() * 3 == image.data.size(), "the body is drawn at the frame's size");
    for (size_t p = 0; p < body.mask.size(); ++p) {
        if (body.mask[p] == 0) continue;
        const double light = body.shade.empty() ? .8 : double(body.shade[p]);
        for (size_t c = 0; c < 3; ++c) {
            uint8_t& value = image.data[3 * p + c];
            value = uint8_t(std::lround((1 - kOpaque) * value + kOpaque * kTint[c] * light));
        }
    }
    const int side = std::max(frame.width, frame.height);
    const int thickness = std::max(1, side / 500);
    if (!frame.mask.empty()) drawOutline(image, frame.mask, thickness, {40, 255, 80});
    drawOutline(image, body.mask, thickness, {255, 255, 255});
    if (side <= longest) return image;
    const auto scaled = [&](int length) {
        return std::max(1, int(std::lround(double(length) * longest / side)));
    };
    return resize(image, scaled(frame.width), scaled(frame.height));
}

Image tiles(std::span<const Image> pictures, int columns) {
    CHECK(!pictures.empty() && columns > 0, "there are pictures to put side by side");
    const int w = pictures[0].width, h = pictures[0].height;
    const int rows = (int(pictures.size()) + columns - 1) / columns;
    columns = std::min(columns, int(pictures.size()));
    Image sheet(columns * w, rows * h, 3, 255);
    for (size_t i = 0; i < pictures.size(); ++i) {
        CHECK(pictures[i].width == w && pictures[i].height == h && pictures[i].channels == 3,
              "pictures side by side have one size");
        const int left = int(i) % columns * w, top = int(i) / columns * h;
        for (int y = 0; y < h; ++y) {
            std::copy_n(pictures[i].row(y), pictures[i].rowBytes(), sheet.pixel(left, top + y));
        }
    }
    return sheet;
}

}  // namespace doppel
