#include "viewer/picture/backdrop.h"

#include <algorithm>
#include <cmath>

namespace doppel {

namespace {

uint32_t packed(int r, int g, int b) {
    return static_cast<uint32_t>(r) | static_cast<uint32_t>(g) << 8 |
           static_cast<uint32_t>(b) << 16 | 0xff000000u;
}

}  // namespace

std::vector<uint32_t> backdropPixels(int width, int height, const BackdropSource& backdrop) {
    const auto byte = [&](size_t c) {
        return static_cast<int>(std::lround(255 * std::clamp(backdrop.colour[c], 0.f, 1.f)));
    };
    std::vector<uint32_t> pixels(static_cast<size_t>(width) * static_cast<size_t>(height),
                                 packed(byte(0), byte(1), byte(2)));
    const auto place = [&](const Image& image, int left, int top) {
        for (int y = std::max(0, top); y < std::min(height, top + image.height); ++y)
            for (int x = std::max(0, left); x < std::min(width, left + image.width); ++x) {
                const uint8_t* rgb = image.pixel(x - left, y - top);
                pixels[static_cast<size_t>(y) * static_cast<size_t>(width) +
                       static_cast<size_t>(x)] = packed(rgb[0], rgb[1], rgb[2]);
            }
    };
    if (const Picture* own = backdrop.frame) {
        Image image(own->width, own->height, 3);
        image.data = own->rgb;
        const double scale = std::min(static_cast<double>(width) / own->width,
                                      static_cast<double>(height) / own->height);
        const int wide = std::max(1, static_cast<int>(std::lround(own->width * scale)));
        const int high = std::max(1, static_cast<int>(std::lround(own->height * scale)));
        place(resize(image, wide, high),
              static_cast<int>(std::lround((width - own->width * scale) / 2)),
              static_cast<int>(std::lround((height - own->height * scale) / 2)));
    } else if (const Image* picture = backdrop.picture) {
        const double scale = std::max(static_cast<double>(width) / picture->width,
                                      static_cast<double>(height) / picture->height);
        const int wide = std::max(width, static_cast<int>(picture->width * scale));
        const int high = std::max(height, static_cast<int>(picture->height * scale));
        place(resize(*picture, wide, high), (width - wide) / 2, (height - high) / 2);
    }
    return pixels;
}

}  // namespace doppel
