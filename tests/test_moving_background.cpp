// What is behind the person, from other pictures of a camera that moves.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/op_test.h"
#include "trainer/data/random.h"
#include "trainer/person/masks/moving_background.h"

namespace doppel {
namespace {

constexpr int kWidth = 320, kHeight = 400;
constexpr double kSide = 300;  // of the network's square
const Rect kWhole{0, 0, kWidth, kHeight};

// Values of 255 at a place of a plane: noise at the corners of squares of five, between them
// linear.
double plane(double x, double y, uint64_t seed, int channel) {
    const auto at = [&](int i, int j) {
        return 40 +
               150 * double(uniformOf(seed, uint64_t((i + 500) * 3000 + (j + 500) * 3 + channel)));
    };
    const double u = x / 5, v = y / 5;
    const int i = int(std::floor(u)), j = int(std::floor(v));
    const double a = u - i, b = v - j;
    return (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) +
           b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
}

// A person, 60 wide and 200 high, of one colour, who walks to the right before a wall; a shelf,
// which is nearer than the wall, is below row 250. The camera is moved by a hand, and its exposure
// drifts.
struct Scene {
    std::vector<ClipView> views;
    std::vector<std::vector<uint8_t>> person;

    static constexpr int kPictures = 9;
    static int left(int f) { return 60 + 24 * f; }

    // others: of the pictures after the first, which may show another place.
    explicit Scene(uint64_t others = 1) {
        for (int f = 0; f < kPictures; ++f) {
            const double across = 9 * std::sin(1.7 * f), down = 7 * std::cos(2.3 * f),
                         turn = .01 * std::sin(f), gain = 1 + .08 * std::sin(1.1 * f);
            ClipView view{Image(kWidth, kHeight, 3),
                          std::vector<float>(size_t(kWidth) * size_t(kHeight)),
                          {},
                          kSide};
            std::vector<uint8_t> inside(view.share.size());
            for (int y = 0; y < kHeight; ++y)
                for (int x = 0; x < kWidth; ++x) {
                    const size_t i = size_t(y) * kWidth + size_t(x);
                    inside[i] = x >= left(f) && x < left(f) + 60 && y >= 100 && y < 300;
                    view.share[i] = inside[i] ? .98f : .02f;
                    const double nearer = y >= 250 ? 1.3 : 1;
                    const double u = x + nearer * across + turn * (y - 200),
                                 v = y + nearer * down - turn * (x - 160);
                    for (int c = 0; c < 3; ++c) {
                        const double noise =
                            3 *
                            (double(uniformOf(9, (uint64_t(f) << 32) + 3 * i + size_t(c))) - .5);
                        const double colour =
                            inside[i] ? (c == 0 ? 60 : 140) : plane(u, v, f > 0 ? others : 1, c);
                        view.rgb.pixel(x, y)[c] =
                            uint8_t(std::clamp(gain * colour + noise, 0., 255.));
                    }
                }
            views.push_back(std::move(view));
            person.push_back(std::move(inside));
        }
    }

    std::vector<float> favour(size_t picture) const {
        MovingBackground background;
        for (const ClipView& view : views) background.add(view.share, kWidth, kHeight);
        EXPECT_TRUE(background.tells());
        return background.favour(
            picture, views[picture], kWhole, std::vector<uint8_t>(views[picture].share.size(), 1),
            [&](size_t other) { return std::make_shared<ClipView>(views[other]); });
    }
};

TEST(MovingBackground, OtherPicturesShowWhatIsBehind) {
    const Scene scene;
    const std::vector<float> favour = scene.favour(0);
    size_t behind = 0, right = 0, wrong = 0, person = 0, personRight = 0, personWrong = 0;
    // The person and what is near.
    for (int y = 88; y < 312; ++y)
        for (int x = 48; x < 132; ++x) {
            const size_t i = size_t(y) * kWidth + size_t(x);
            if (scene.person[0][i]) {
                ++person;
                personRight += favour[i] > 2;
                personWrong += favour[i] < -2;
            } else {
                ++behind;
                right += favour[i] < -2;
                wrong += favour[i] > 0;
            }
        }
    EXPECT_GT(double(personRight), .5 * double(person));
    EXPECT_LT(double(personWrong), .01 * double(person));
    EXPECT_GT(double(right), .8 * double(behind));
    EXPECT_LT(double(wrong), .01 * double(behind));
}

TEST(MovingBackground, WhatShowsSomethingElseTellsNothing) {
    EXPECT_TRUE(std::ranges::all_of(Scene(2).favour(0), [](float f) { return f == 0; }));
}

TEST(MovingBackground, OnlyWhatIsWantedIsTold) {
    const Scene scene;
    MovingBackground background;
    for (const ClipView& view : scene.views) background.add(view.share, kWidth, kHeight);
    const Rect part{30, 90, 130, 310};
    std::vector<uint8_t> wanted(size_t(part.width()) * size_t(part.height()));
    for (size_t i = 0; i < wanted.size(); ++i) wanted[i] = i % size_t(part.width()) < 50;
    const auto favour = background.favour(0, scene.views[0], part, wanted, [&](size_t other) {
        return std::make_shared<ClipView>(scene.views[other]);
    });
    size_t some = 0;
    for (size_t i = 0; i < favour.size(); ++i) {
        some += favour[i] != 0;
        if (!wanted[i]) {
            ASSERT_EQ(favour[i], 0);
        }
    }
    EXPECT_GT(some, favour.size() / 4);
}

TEST(MovingBackground, FewPicturesTellNothing) {
    MovingBackground background;
    for (int f = 0; f < 3; ++f) {
        EXPECT_FALSE(background.tells());
        background.add(std::vector<float>(size_t(kWidth) * size_t(kHeight)), kWidth, kHeight);
    }
}

}  // namespace
}  // namespace doppel
