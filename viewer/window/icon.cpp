#include "viewer/window/icon.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/glm.hpp>
#include <span>
#include <utility>

namespace doppel {

namespace {

using Point = glm::dvec2;  // in a square of 64 by 64
constexpr double kSide = 64, kCorner = 14, kStroke = 1.5;
using Colour = std::array<uint8_t, 3>;
constexpr Colour kBacking{0x22, 0x30, 0x3c}, kDouble{0x6f, 0xb3, 0xd9}, kPerson{0xf2, 0xc7, 0x9b};

// The double's mesh: each from point to point.
constexpr std::array<std::pair<Point, Point>, 22> kLines = {{
    // The head.
    {{40, 9}, {46, 13}},
    {{46, 13}, {46, 19}},
    {{46, 19}, {40, 23}},
    {{40, 23}, {34, 19}},
    {{34, 19}, {34, 13}},
    {{34, 13}, {40, 9}},
    {{40, 9}, {40, 23}},
    {{34, 13}, {46, 19}},
    {{46, 13}, {34, 19}},
    // The body.
    {{30, 28}, {50, 28}},
    {{50, 28}, {55, 43}},
    {{55, 43}, {53, 45}},
    {{53, 45}, {47, 37}},
    {{47, 37}, {47, 55}},
    {{47, 55}, {33, 55}},
    {{33, 55}, {33, 37}},
    {{33, 37}, {30, 28}},
    {{30, 28}, {47, 37}},
    {{50, 28}, {33, 37}},
    {{33, 37}, {47, 37}},
    {{33, 55}, {40, 37}},
    {{40, 37}, {47, 55}},
}};

constexpr std::array<Point, 27> kBody = {
    {{16, 26},     {32, 26},     {34, 26.6},   {35, 28},   {40, 42},    {39.9, 43.6},
     {38.6, 44.8}, {36.9, 44.8}, {35.8, 43.5}, {32, 34},   {32, 55},    {31.4, 56.4},
     {30, 57},     {26.5, 57},   {24, 42},     {21.5, 57}, {18, 57},    {16.6, 56.4},
     {16, 55},     {16, 34},     {12.2, 43.5}, {11, 44.8}, {9.4, 44.8}, {8.1, 43.6},
     {8, 42},      {13, 28},     {14, 26.6}}};

bool inBacking(const Point& p) {
    const Point beyond = glm::max(glm::abs(p - kSide / 2) - (kSide / 2 - kCorner), Point(0));
    return glm::length(beyond) <= kCorner;
}

double distanceTo(const Point& p, const std::pair<Point, Point>& line) {
    const Point along = line.second - line.first;
    const double at = std::clamp(glm::dot(p - line.first, along) / glm::dot(along, along), 0., 1.);
    return glm::distance(p, line.first + at * along);
}

bool inBody(const Point& p) {
    bool inside = false;
    for (size_t i = 0, before = kBody.size() - 1; i < kBody.size(); before = i++) {
        const Point &a = kBody[i], &b = kBody[before];
        if ((a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x)
            inside = !inside;
    }
    return inside;
}

// Of what is uppermost there; null: nothing.
const Colour* colourAt(const Point& p) {
    if (!inBacking(p)) return nullptr;
    if (glm::distance(p, Point(24, 16)) <= 7 || inBody(p)) return &kPerson;
    const auto covers = [&](const std::pair<Point, Point>& line) {
        return distanceTo(p, line) <= kStroke / 2;
    };
    return std::ranges::any_of(kLines, covers) ? &kDouble : &kBacking;
}

}  // namespace

Image applicationIcon(int side) {
    constexpr int kSamples = 4;  // per pixel and axis
    Image icon(side, side, 4);
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) {
            std::array<int, 3> sums{};
            int covered = 0;
            for (int s = 0; s < kSamples * kSamples; ++s) {
                const Point place(x + (s % kSamples + .5) / kSamples,
                                  y + (s / kSamples + .5) / kSamples);
                const Colour* colour = colourAt(place * (kSide / side));
                if (!colour) continue;
                ++covered;
                for (size_t c = 0; c < 3; ++c) sums[c] += (*colour)[c];
            }
            for (int c = 0; c < 3 && covered > 0; ++c)
                icon.pixel(x, y)[c] = static_cast<uint8_t>(sums[static_cast<size_t>(c)] / covered);
            icon.pixel(x, y)[3] = static_cast<uint8_t>(255 * covered / (kSamples * kSamples));
        }
    return icon;
}

}  // namespace doppel
