#include "viewer/picture/backdrop.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

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
        if (backdrop.marksPerson)
            for (size_t i = 0; i < own->mask.size(); ++i)
                for (size_t c = 0; c < 3 && own->mask[i] > 0; ++c) image.data[3 * i + c] ^= 0x80;
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

void putInFront(std::span<uint32_t> picture, std::span<const uint32_t> frame,
                const FrameInFront& how) {
    CHECK(picture.size() == frame.size(), "the frame is as large as the picture");
    for (size_t i = 0; i < picture.size(); ++i) {
        uint32_t word = picture[i] & 0xff000000u;
        for (size_t c = 0; c < 3; ++c) {
            const int own = int(picture[i] >> 8 * c & 0xff), other = int(frame[i] >> 8 * c & 0xff);
            const int made = how.as == Backdrop::Difference
                                 ? std::min(255, how.times * std::abs(own - other))
                                 : int(std::lround(std::lerp(own, other, how.opacity)));
            word |= static_cast<uint32_t>(made) << 8 * c;
        }
        picture[i] = word;
    }
}

}  // namespace doppel
