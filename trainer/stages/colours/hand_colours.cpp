#include "trainer/stages/colours/hand_colours.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "nn/body/texel_places.h"
#include "trainer/avatar/background.h"

namespace doppel {

namespace {

constexpr float kFar = 2.5f;         // times the median distance of chromaticities
constexpr float kLeastFar = .03f;    // which in a picture is noise
constexpr float kBrightness = 3;     // times as bright, or a part of it
constexpr float kLeastLight = .02f;  // darker ones have no chromaticity

float median(std::vector<float> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::ranges::nth_element(values, middle);
    return *middle;
}

struct Colour {
    float light, red, green;  // the sum of the channels, and the parts of two of them
};

Colour colourOf(const float* rgb) {
    const float light = rgb[0] + rgb[1] + rgb[2];
    if (light < kLeastLight) return {light, 1 / 3.f, 1 / 3.f};
    return {light, rgb[0] / light, rgb[1] / light};
}

float distance(const Colour& a, const Colour& b) {
    return std::hypot(a.red - b.red, a.green - b.green);
}

}  // namespace

size_t cleanHands(const BodyModel& body, int size, std::vector<float>& texels) {
    const std::vector<TexelPlace> places = texelPlaces(body, size);
    std::vector<size_t> hands;
    std::vector<Colour> colours;
    for (size_t i = 0; i < places.size(); ++i) {
        if (places[i].face < 0) continue;
        const int32_t* corners = &body.faces[3 * static_cast<size_t>(places[i].face)];
        const bool onHand = std::all_of(corners, corners + 3, [&](int32_t v) {
            const auto part = body.part[static_cast<size_t>(v)];
            return part == kLeftHand || part == kRightHand;
        });
        if (!onHand) continue;
        hands.push_back(i);
        colours.push_back(colourOf(&texels[3 * i]));
    }
    if (hands.empty()) return 0;
    const auto medianOf = [&](auto number) {
        std::vector<float> values;
        for (const Colour& colour : colours) values.push_back(number(colour));
        return median(std::move(values));
    };
    const Colour usual{medianOf([](const Colour& c) { return c.light; }),
                       medianOf([](const Colour& c) { return c.red; }),
                       medianOf([](const Colour& c) { return c.green; })};
    const float far =
        std::max(kLeastFar, kFar * medianOf([&](const Colour& c) { return distance(c, usual); }));
    std::vector<uint8_t> known(places.size());
    std::vector<size_t> foreign;
    for (size_t k = 0; k < hands.size(); ++k) {
        const Colour& c = colours[k];
        if (distance(c, usual) > far || c.light > kBrightness * usual.light ||
            c.light * kBrightness < usual.light)
            foreign.push_back(hands[k]);
        else
            known[hands[k]] = 1;
    }
    if (foreign.empty() || 3 * foreign.size() > hands.size()) return 0;
    // From the hands' own texels alone: the chart beside a hand's may be the trousers'.
    std::vector<float> filled = texels;
    const auto side = static_cast<size_t>(size);
    fillHoles(filled, known, side, side);
    for (size_t i : foreign) std::copy_n(&filled[3 * i], 3, &texels[3 * i]);
    return foreign.size();
}

}  // namespace doppel
