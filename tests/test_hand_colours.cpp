// What fingers lie before leaves its colours on them: hands have one colour, or are left alone.
#include "trainer/stages/colours/hand_colours.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "nn/body/texel_places.h"
#include "trainer/avatar/avatar.h"

namespace doppel::test {
namespace {

constexpr int kSide = 128;
using Rgb = std::array<float, 3>;
constexpr Rgb kSkin{.8f, .6f, .5f}, kDenim{.2f, .3f, .5f};

struct Painted {
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    std::vector<float> texels = std::vector<float>(size_t{3} * kSide * kSide);
    std::vector<size_t> hands;

    // Hands of a skin that is lit a little differently from texel to texel; all else is denim.
    Painted() {
        const std::vector<TexelPlace> places = texelPlaces(body, kSide);
        for (size_t i = 0; i < places.size(); ++i) {
            paint(i, kDenim);
            if (places[i].face < 0) continue;
            bool onHand = true;
            for (size_t k = 0; k < 3; ++k) {
                const auto v = body.faces[3 * static_cast<size_t>(places[i].face) + k];
                const auto part = body.part[static_cast<size_t>(v)];
                onHand = onHand && (part == kLeftHand || part == kRightHand);
            }
            if (!onHand) continue;
            hands.push_back(i);
            const float light = 1 - .1f * static_cast<float>(i % 3);
            paint(i, {light * kSkin[0], light * kSkin[1], light * kSkin[2]});
        }
    }
    void paint(size_t texel, const Rgb& colour) {
        std::ranges::copy(colour, texels.begin() + static_cast<std::ptrdiff_t>(3 * texel));
    }
};

TEST(HandColours, WhatIsBehindFingersIsTakenOffThem) {
    Painted painted;
    ASSERT_GT(painted.hands.size(), 200u);
    const std::vector<float> before = painted.texels;
    std::vector<size_t> foreign;
    for (size_t k = 0; k < painted.hands.size(); ++k)
        if (k % 8 < 2) foreign.push_back(painted.hands[k]);
    for (size_t i : foreign) painted.paint(i, kDenim);
    std::vector<float> texels = painted.texels;
    EXPECT_EQ(cleanHands(painted.body, kSide, texels), foreign.size());
    for (size_t i : foreign)
        for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(texels[3 * i + c], .9f * kSkin[c], .12f) << i;
    // Nothing else has changed, sleeves and trousers least of all.
    for (size_t i : foreign) std::copy_n(&before[3 * i], 3, &texels[3 * i]);
    EXPECT_EQ(texels, before);
}

TEST(HandColours, GlovesOfTwoColoursStay) {
    Painted painted;
    for (size_t k = 0; k < painted.hands.size(); ++k)
        painted.paint(painted.hands[k], k % 5 < 3 ? Rgb{.1f, .1f, .1f} : Rgb{.9f, .9f, .9f});
    std::vector<float> texels = painted.texels;
    EXPECT_EQ(cleanHands(painted.body, kSide, texels), 0u);
    EXPECT_EQ(texels, painted.texels);
}

TEST(HandColours, CleanHandsStay) {
    Painted painted;
    std::vector<float> texels = painted.texels;
    EXPECT_EQ(cleanHands(painted.body, kSide, texels), 0u);
    EXPECT_EQ(texels, painted.texels);
}

}  // namespace
}  // namespace doppel::test
