#include "trainer/import/overlay.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

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

namespace {

Image atMost(const Image& image, int longest) {
    const int side = std::max(image.width, image.height);
    if (side <= longest) return image;
    const auto scaled = [&](int length) {
        return std::max(1, int(std::lround(double(length) * longest / side)));
    };
    return resize(image, scaled(image.width), scaled(image.height));
}

using Colour = std::array<double, 3>;

// A line between pixels, mixed into what is there; its ends are round.
void drawLine(Image& image, double x0, double y0, double x1, double y1, double thickness,
              const Colour& colour, double opaque) {
    const double far = 4. * (image.width + image.height);
    for (double v : {x0, y0, x1, y1})
        if (!(std::abs(v) < far)) return;
    const auto first = [&](double a, double b) {
        return int(std::floor(std::min(a, b) - thickness));
    };
    const auto last = [&](double a, double b) {
        return int(std::ceil(std::max(a, b) + thickness));
    };
    const double dx = x1 - x0, dy = y1 - y0, length = std::max(dx * dx + dy * dy, 1e-9);
    for (int y = std::max(first(y0, y1), 0); y < std::min(last(y0, y1), image.height); ++y)
        for (int x = std::max(first(x0, x1), 0); x < std::min(last(x0, x1), image.width); ++x) {
            const double px = x + .5 - x0, py = y + .5 - y0;
            const double t = std::clamp((px * dx + py * dy) / length, 0., 1.);
            const double away = std::hypot(px - t * dx, py - t * dy);
            const double share = opaque * std::clamp(thickness / 2 + .5 - away, 0., 1.);
            for (size_t c = 0; c < 3; ++c) {
                uint8_t& value = image.pixel(x, y)[c];
                value = uint8_t(std::lround((1 - share) * value + share * colour[c]));
            }
        }
}

// Digits of three by five pixels, rows from the top, three bits each.
constexpr std::array<std::array<uint8_t, 5>, 10> kDigits{{{7, 5, 5, 5, 7},
                                                          {2, 6, 2, 2, 7},
                                                          {7, 1, 7, 4, 7},
                                                          {7, 1, 7, 1, 7},
                                                          {5, 5, 7, 1, 1},
                                                          {7, 4, 7, 1, 7},
                                                          {7, 4, 7, 5, 7},
                                                          {7, 1, 1, 2, 2},
                                                          {7, 5, 7, 5, 7},
                                                          {7, 5, 7, 1, 7}}};

void fill(Image& image, int left, int top, int right, int bottom, const Colour& colour) {
    for (int y = std::max(top, 0); y < std::min(bottom, image.height); ++y)
        for (int x = std::max(left, 0); x < std::min(right, image.width); ++x)
            for (size_t c = 0; c < 3; ++c) image.pixel(x, y)[c] = uint8_t(colour[c]);
}

void drawNumber(Image& image, int left, int top, size_t number, int dot, const Colour& colour) {
    const std::string text = std::to_string(number);
    fill(image, left, top, left + (4 * int(text.size()) + 1) * dot, top + 7 * dot, colour);
    for (size_t i = 0; i < text.size(); ++i)
        for (int row = 0; row < 5; ++row)
            for (int column = 0; column < 3; ++column) {
                if (!(kDigits[size_t(text[i] - '0')][size_t(row)] >> (2 - column) & 1)) continue;
                const int x = left + (4 * int(i) + 1 + column) * dot, y = top + (1 + row) * dot;
                fill(image, x, y, x + dot, y + dot, {0, 0, 0});
            }
}

}  // namespace

Image skeletonPicture(const Picture& frame, std::span<const float> keypoints, int longest) {
    CHECK(keypoints.size() == 75, "keypoints are [25][3]");
    struct Bone {
        size_t from, to;
        int side;  // 1 left, −1 right
    };
    constexpr std::array<Bone, 22> kBones{
        {{0, 1, 0},   {1, 2, -1},   {2, 3, -1},   {3, 4, -1},   {1, 5, 1},    {5, 6, 1},
         {6, 7, 1},   {1, 8, 0},    {8, 9, -1},   {9, 10, -1},  {10, 11, -1}, {8, 12, 1},
         {12, 13, 1}, {13, 14, 1},  {11, 24, -1}, {11, 22, -1}, {14, 21, 1},  {14, 19, 1},
         {0, 15, -1}, {15, 17, -1}, {0, 16, 1},   {16, 18, 1}}};
    Image image(frame.width, frame.height, 3);
    image.data = frame.rgb;
    for (size_t p = 0; p < frame.mask.size(); ++p)
        if (frame.mask[p] == 0)
            for (size_t c = 0; c < 3; ++c) image.data[3 * p + c] /= 3;
    const double thickness = std::max(1.5, std::max(frame.width, frame.height) / 240.);
    for (const Bone& bone : kBones) {
        const float *a = &keypoints[3 * bone.from], *b = &keypoints[3 * bone.to];
        const double sure = double(std::min(a[2], b[2]));
        const Colour colour = bone.side > 0   ? Colour{255, 150, 40}
                              : bone.side < 0 ? Colour{60, 150, 255}
                                              : Colour{255, 255, 255};
        drawLine(image, double(a[0]), double(a[1]), double(b[0]), double(b[1]), thickness, colour,
                 .15 + .85 * std::clamp(sure, 0., 1.));
    }
    return atMost(image, longest);
}

Image numberedPicture(const Image& rgb, std::span<const Box> boxes, size_t chosen, int longest) {
    const double share = std::min(1., double(longest) / std::max(rgb.width, rgb.height));
    Image image = atMost(rgb, longest);
    const int side = std::max(image.width, image.height);
    for (size_t i = 0; i < boxes.size(); ++i) {
        const Colour colour = i == chosen ? Colour{40, 255, 80} : Colour{255, 255, 255};
        const double left = boxes[i].left * share, right = boxes[i].right * share,
                     top = boxes[i].top * share, bottom = boxes[i].bottom * share;
        const double thickness = std::max(1.5, side / 300.);
        drawLine(image, left, top, right, top, thickness, colour, 1);
        drawLine(image, left, bottom, right, bottom, thickness, colour, 1);
        drawLine(image, left, top, left, bottom, thickness, colour, 1);
        drawLine(image, right, top, right, bottom, thickness, colour, 1);
        drawNumber(image, std::clamp(int(left), 0, image.width - 1),
                   std::clamp(int(top), 0, image.height - 1), i + 1, std::max(2, side / 200),
                   colour);
    }
    return image;
}

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
    return atMost(image, longest);
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
