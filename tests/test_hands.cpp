// What fingers lie before leaves its colours on them: hands have one colour, or are left alone. And
// hands that hang half closed are learned from their outlines.
#include "trainer/stages/colours/hand_colours.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "nn/body/fingers.h"
#include "nn/body/texel_places.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/recorded_body.h"
#include "trainer/avatar/avatar.h"
#include "trainer/stages/surface.h"

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

// Somebody whose hands are not the model's, turning once.
struct HalfClosed {
    static constexpr HandAmounts kAmounts{.9f, .8f, .5f, .9f};
    BodyModel flat = bodyFromNpz(readBodyArrays("default"));
    FingerRig rig = fingerRig(flat);
    std::vector<float> truth = bentFingers(rig, flat.templateVertices, kAmounts);
    Folder folder;
    Capture capture;

    HalfClosed() { capture = recordedBody(flat, truth, 8, 384, folder / "capture"); }
    // Where fingers are off, mm in the mean.
    double error(const std::vector<float>& offsets) const {
        double sum = 0, count = 0;
        for (size_t v = 0; v + 1 < rig.begin.size(); ++v) {
            for (int e = rig.begin[v]; e < rig.begin[v + 1]; ++e)
                if (const float weight = rig.entries[size_t(5 * e)]; weight > .99f) {
                    double square = 0;
                    for (size_t c = 3 * v; c < 3 * v + 3; ++c) {
                        const double at = double{flat.templateVertices[c]} +
                                          (offsets.empty() ? 0. : double{offsets[c]});
                        square += (at - double{truth[c]}) * (at - double{truth[c]});
                    }
                    sum += std::sqrt(square);
                    ++count;
                }
        }
        return 1000 * sum / count;
    }
};

SurfaceRun shaping(double lrHands) {
    SurfaceRun run{.stage = "shape", .preset = presetByName("ci").shape, .movesOffsets = true};
    run.preset.size = 384;
    run.preset.steps = 70;
    run.preset.lrHands = lrHands;
    return run;
}

TEST(Hands, AreLearnedFromTheirOutlines) {
    HalfClosed person;
    const double before = person.error({});
    EXPECT_GT(before, 15);
    const Capture given = person.capture;
    const auto learned = runSurface(testDevice(), person.flat, person.capture, shaping(.04));
    person.capture = given;
    const auto stiff = runSurface(testDevice(), person.flat, person.capture, shaping(0));
    ASSERT_TRUE(learned && stiff);
    EXPECT_LT(person.error(learned->offsets), .4 * before);
    EXPECT_GT(person.error(stiff->offsets), .6 * before);  // free offsets alone do not bend fingers

    // Later stages leave them so, however stiff hands are.
    BodyModel body = person.flat;
    body.offsets = learned->offsets;
    person.capture = given;
    SurfaceRun more = shaping(0);
    more.preset.steps = 20;
    const auto later = runSurface(testDevice(), body, person.capture, more);
    ASSERT_TRUE(later);
    EXPECT_LT(person.error(later->offsets), .45 * before);
}

TEST(Hands, BeginWhereTheyAreSaidToBe) {
    HalfClosed person;
    SurfaceRun run = shaping(1e-6);
    run.hands = HalfClosed::kAmounts;
    run.preset.steps = 2;
    run.preset.lrOffsets = 0;
    const auto result = runSurface(testDevice(), person.flat, person.capture, run);
    ASSERT_TRUE(result);
    EXPECT_LT(person.error(result->offsets), 1);
}

}  // namespace
}  // namespace doppel::test
