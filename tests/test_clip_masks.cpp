// Masks by what a whole clip shows: its colours, a camera that stands still, a plate, a screen.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>

#include "engine/error.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/data/random.h"
#include "trainer/eval/metrics.h"
#include "trainer/import/masks/clip_cutter.h"
#include "trainer/motion/hand_held.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

// A filmed actor, and shares as blurred as a network's whose edges are some pixels off.
struct Filmed {
    Folder folder;
    std::vector<Image> pictures;
    std::vector<std::vector<uint8_t>> truth;
    std::vector<std::vector<float>> shares;
    std::vector<std::vector<uint8_t>> part;
    static constexpr double kSide = 400;  // of the network's square

    explicit Filmed(const HandHeldOptions& given, int frames = 6) {
        static const Actor actor = readActor(assetFolder() / "actor", "woman");
        HandHeldOptions options = given;
        options.width = 225, options.height = 400;
        const Performer performer{&actor, oneTake(frames, kTakeDistance)};
        filmHandHeld(testDevice(), {&performer, 1}, folder / "clip.mp4", folder / "truth", options);
        VideoReader video(folder / "clip.mp4");
        for (Image picture; video.next(picture);) {
            // The writer pads odd sides.
            Image cut(225, 400, 3);
            for (int y = 0; y < 400; ++y) std::copy_n(picture.row(y), cut.rowBytes(), cut.row(y));
            pictures.push_back(cut);
        }
        for (size_t f = 0; f < pictures.size(); ++f) {
            const Image mask = readMask(folder / "truth/masks" / fmt::format("{:06}.png", f));
            truth.push_back(mask.data);
            shares.push_back(share(mask, f));
            part.push_back(parts(mask));
        }
    }

    // The mask shifted by up to 2 pixels, at a fifth of its size and back.
    static std::vector<float> share(const Image& mask, size_t frame) {
        Image moved(mask.width, mask.height, 1);
        const int right = int(5 * uniformOf(3, frame)) - 2, down = int(5 * uniformOf(4, frame)) - 2;
        for (int y = 0; y < mask.height; ++y)
            for (int x = 0; x < mask.width; ++x)
                *moved.pixel(x, y) = *mask.pixel(std::clamp(x - right, 0, mask.width - 1),
                                                 std::clamp(y - down, 0, mask.height - 1));
        const Image blurred =
            resize(resize(moved, mask.width / 5, mask.height / 5), mask.width, mask.height);
        std::vector<float> share;
        for (uint8_t v : blurred.data) share.push_back(float(v) / 255);
        return share;
    }

    // Of somebody upright, by height alone.
    static std::vector<uint8_t> parts(const Image& mask) {
        int top = mask.height, bottom = 0;
        for (int y = 0; y < mask.height; ++y)
            if (std::find(mask.row(y), mask.row(y) + mask.width, 255) != mask.row(y) + mask.width)
                top = std::min(top, y), bottom = y;
        using enum PicturedPart;
        std::vector<uint8_t> parts;
        for (int y = 0; y < mask.height; ++y) {
            const double down = double(y - top) / (bottom - top);
            const auto part = down < .16   ? Head
                              : down < .5  ? Trunk
                              : down < .72 ? Thigh
                              : down < .92 ? Calf
                                           : Foot;
            parts.insert(parts.end(), size_t(mask.width), uint8_t(part));
        }
        return parts;
    }

    std::vector<ClipView> samples() const {
        std::vector<ClipView> result;
        for (size_t f = 0; f < pictures.size(); f += 2) result.push_back(view(f));
        return result;
    }
    void learn(ClipCutter& cutter) const {
        for (size_t f = 0; f < pictures.size(); ++f) cutter.learn(view(f));
        cutter.finish(samples());
    }
    ClipView view(size_t f) const { return {pictures[f], shares[f], part[f], kSide}; }
    FrameCut cut(const ClipCutter& cutter, size_t f) const {
        return cutter.cut(f, view(f),
                          [&](size_t other) { return std::make_shared<ClipView>(view(other)); });
    }
    double iou(const ClipCutter& cutter) const {
        double sum = 0;
        for (size_t f = 0; f < pictures.size(); ++f)
            sum += intersectionOverUnion(cut(cutter, f).mask, truth[f]);
        return sum / double(pictures.size());
    }
};

TEST(ClipCutter, AWholeClipsColoursTellMore) {
    const Filmed film({}, 12);
    const auto learnt = [&](const char* by) {
        ClipCutter cutter("", nullptr, cutOutByName(by));
        film.learn(cutter);
        return cutter;
    };
    const ClipCutter network = learnt("network"), edges = learnt("edges"),
                     colours = learnt("colours"), cutter = learnt("all");
    std::cout << "the network's " << film.iou(network) << ", led along edges " << film.iou(edges)
              << ", by the clip's colours " << film.iou(colours) << ", and by what is behind "
              << film.iou(cutter) << "\n";
    EXPECT_GT(film.iou(edges), film.iou(network) + .02);
    EXPECT_GT(film.iou(colours), film.iou(edges) + .02);
    EXPECT_GT(film.iou(colours), .945);
    EXPECT_GT(film.iou(cutter), film.iou(colours) + .005);
    EXPECT_EQ(network.source(), "the network");
    EXPECT_EQ(edges.source(), "the network, led along edges");
    EXPECT_EQ(colours.source(), "the clip's colours");
    EXPECT_EQ(cutter.source(), "the clip's colours and what is behind, as other frames show it");
    EXPECT_THROW(cutOutByName("colors"), InputError);
    const FrameCut cut = film.cut(cutter, 0);
    EXPECT_GT(cut.network, .7);
    EXPECT_LT(cut.network, .97);
    EXPECT_GT(cut.doubtful, 0);
    EXPECT_LT(cut.doubtful, .4);
    // Nobody there, nobody cut out.
    const FrameCut nobody =
        cutter.cut(0,
                   {film.pictures[0], std::vector<float>(film.shares[0].size()),
                    std::vector<uint8_t>(film.shares[0].size()), Filmed::kSide},
                   [&](size_t other) { return std::make_shared<ClipView>(film.view(other)); });
    EXPECT_EQ(std::ranges::count(nobody.mask, 255), 0);
}

// A network that sees a trunk and one foot, whose landmarks know of the other.
TEST(PersonShare, FeetWithoutAMaskAreInDoubt) {
    constexpr int kSize = 256;
    PersonLandmarks person;
    person.roi = {{128, 128}, 256, 0};
    person.mask.assign(size_t(kRoiMaskSide) * kRoiMaskSide, -8);
    const auto at = [](int x, int y) { return size_t(y) * kSize + size_t(x); };
    for (int y = 60; y < 230; ++y)
        for (int x = 100; x < 130; ++x) person.mask[at(x, y)] = 8;
    for (Landmark& point : person.points) point.picture = {115, 150, 0};
    person.points[landmark::kLeftAnkle].picture = {110, 210, 0};
    person.points[landmark::kLeftHeel].picture = {108, 220, 0};
    person.points[landmark::kLeftFootTip].picture = {128, 222, 0};
    person.points[landmark::kRightAnkle].picture = {140, 205, 0};
    person.points[landmark::kRightHeel].picture = {138, 214, 0};
    person.points[landmark::kRightFootTip].picture = {165, 216, 0};
    const auto without = personShare(person, kSize, kSize);
    const auto share = personShareWithFeet(person, kSize, kSize);
    for (const auto& [x, y] : {std::pair{140, 206}, {139, 214}, {150, 214}, {164, 216}}) {
        EXPECT_LT(without[at(x, y)], .01);
        EXPECT_NEAR(share[at(x, y)], .49, 1e-6);
    }
    for (const auto& [x, y] : {std::pair{115, 150}, {110, 215}, {180, 216}, {150, 190}, {20, 20}})
        EXPECT_EQ(share[at(x, y)], without[at(x, y)]) << x << " " << y;
    // Nor is what lies beside a foot that the mask has.
    EXPECT_LT(without[at(131, 222)], .2);
    EXPECT_EQ(share[at(131, 222)], without[at(131, 222)]);
    // Landmarks may be anywhere.
    person.points[landmark::kRightFootTip].picture = {1e6, -1e6, 0};
    EXPECT_EQ(personShareWithFeet(person, kSize, kSize).size(), size_t(kSize) * kSize);
}

TEST(PicturedParts, EachPixelIsNextToOne) {
    constexpr int kSize = 120;
    PersonLandmarks person;
    for (Landmark& point : person.points) point.picture = {60, 20, 0};  // the head
    const auto put = [&](size_t point, double x, double y) {
        person.points[point].picture = {x, y, 0};
    };
    using namespace landmark;
    put(kLeftShoulder, 75, 35), put(kRightShoulder, 45, 35);
    put(kLeftHip, 70, 65), put(kRightHip, 50, 65);
    put(kLeftElbow, 90, 35), put(kRightElbow, 30, 35);
    put(kLeftWrist, 105, 35), put(kRightWrist, 15, 35);
    put(kLeftIndex, 112, 35), put(kRightIndex, 8, 35);
    put(kLeftKnee, 70, 85), put(kRightKnee, 50, 85);
    put(kLeftAnkle, 70, 105), put(kRightAnkle, 50, 105);
    put(kLeftHeel, 70, 110), put(kRightHeel, 50, 110);
    put(kLeftFootTip, 76, 114), put(kRightFootTip, 44, 114);
    const std::vector<uint8_t> parts = picturedPartsOf(person, kSize, kSize);
    const auto at = [&](int x, int y) { return PicturedPart(parts[size_t(y * kSize + x)]); };
    using enum PicturedPart;
    EXPECT_EQ(at(60, 5), Head);
    EXPECT_EQ(at(60, 50), Trunk);
    for (int side : {-1, 1}) {
        EXPECT_EQ(at(60 + side * 24, 33), UpperArm);
        EXPECT_EQ(at(60 + side * 48, 36), Forearm);
        EXPECT_EQ(at(60 + side * 12, 76), Thigh);
        EXPECT_EQ(at(60 + side * 12, 96), Calf);
        EXPECT_EQ(at(60 + side * 16, 116), Foot);
    }
    // Landmarks may be anywhere, and nowhere.
    put(kLeftKnee, 1e300, -1e300), put(kRightKnee, NAN, NAN);
    for (uint8_t part : picturedPartsOf(person, 7, 5)) EXPECT_LT(part, kPicturedParts);
}

// A network closes the gap between an arm and a trunk in each fourth frame, and is rather sure of
// it. The wall there is as the wall elsewhere, and in no other frame the trunk's colour.
TEST(ClipCutter, WhatOneFrameTakesForThePersonOthersDoNot) {
    constexpr int kWidth = 120, kHeight = 160, kFrames = 12;
    constexpr double kSide = 400;
    const auto isPerson = [](int x, int y, int f) {
        const int left = 30 + 2 * f;
        const bool trunk = x >= left && x < left + 24, arm = x >= left + 32 && x < left + 40,
                   shoulder = x >= left && x < left + 40 && y < 44;
        return y >= 30 && y < 130 && (trunk || arm || shoulder);
    };
    const auto isGap = [](int x, int y, int f) {
        return x >= 54 + 2 * f && x < 62 + 2 * f && y >= 44 && y < 130;
    };
    std::vector<ClipView> views;
    for (int f = 0; f < kFrames; ++f) {
        ClipView view{Image(kWidth, kHeight, 3), {}, std::vector<uint8_t>(kWidth * kHeight), kSide};
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                const bool person = isPerson(x, y, f);
                uint8_t* p = view.rgb.pixel(x, y);
                for (int c = 0; c < 3; ++c)
                    p[c] = uint8_t((person ? 60 + 40 * c : 140 - 20 * c) +
                                   48 * uniformOf(uint64_t(f), uint64_t((y * kWidth + x) * 3 + c)));
                view.share.push_back(person ? .97f : (f % 4 == 1 && isGap(x, y, f)) ? .9f : .01f);
            }
        views.push_back(std::move(view));
    }
    ClipCutter cutter("", nullptr, CutOutBy::Colours);
    for (const ClipView& view : views) cutter.learn(view);
    cutter.finish(views);
    const FrameCut cut = cutter.cut(
        5, views[5], [&](size_t other) { return std::make_shared<ClipView>(views[other]); });
    double gap = 0, closed = 0, person = 0, kept = 0;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const bool inside = cut.mask[size_t(y * kWidth + x)];
            if (isGap(x, y, 5)) ++gap, closed += inside;
            if (isPerson(x, y, 5)) ++person, kept += inside;
        }
    EXPECT_LT(closed, .1 * gap);
    EXPECT_GT(kept, .98 * person);
}

// Of feet that nobody is sure of, the person's other colours speak.
TEST(ClipColours, OfAPartThatIsNotSeenThePersonTells) {
    ClipView view{Image(40, 40, 3), {}, {}, 40};
    for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 40; ++x) {
            const bool person = x < 20;
            view.rgb.pixel(x, y)[0] = person ? 200 : 40;
            view.share.push_back(person ? 1 : 0);
            view.part.push_back(uint8_t(PicturedPart::Trunk));
        }
    ClipColours colours;
    colours.add(view);
    colours.finish();
    const uint8_t *ours = view.rgb.pixel(5, 5), *behind = view.rgb.pixel(30, 5);
    for (PicturedPart part : {PicturedPart::Trunk, PicturedPart::Foot}) {
        EXPECT_GT(colours.ofPart(size_t(part), ours), .1);
        EXPECT_EQ(colours.ofPart(size_t(part), behind), 0);
    }
    EXPECT_EQ(colours.ofBackground(ours), 0);
    EXPECT_GT(colours.ofBackground(behind), .1);
    // Nothing was seen at all.
    ClipColours none;
    none.finish();
    EXPECT_EQ(none.ofPart(0, ours), 0);
    EXPECT_EQ(none.ofBackground(ours), 0);
}

TEST(ClipCutter, ACameraThatStandsStillIsNoticed) {
    HandHeldOptions options;
    options.still = true;
    const Filmed film(options, 10);
    ClipCutter cutter("");
    film.learn(cutter);
    EXPECT_NE(cutter.source().find("the camera stands still"), std::string::npos);
    EXPECT_GT(film.iou(cutter), .94);
}

TEST(ClipCutter, AScreenIsFoundAndNamed) {
    HandHeldOptions options;
    options.plain = true;
    const Filmed green(options, 4);
    ClipCutter cutter("");
    green.learn(cutter);
    EXPECT_EQ(cutter.source().find("a green screen, #"), 0u) << cutter.source();
    EXPECT_GT(green.iou(cutter), .93);
    options.screen = {.08f, .2f, .75f};
    const Filmed blue(options, 2);
    ClipCutter second("");
    blue.learn(second);
    EXPECT_EQ(second.source().find("a blue screen, #"), 0u) << second.source();
    options.screen = {.6f, .6f, .58f};  // a wall is none
    const Filmed grey(options, 2);
    ClipCutter third("");
    grey.learn(third);
    EXPECT_EQ(third.source().find("screen"), std::string::npos) << third.source();
}

TEST(ClipCutter, APlateIsUsedAndChecked) {
    HandHeldOptions options;
    options.still = true;
    const Filmed film(options, 3);
    // A plate is filmed with the actor out of sight.
    HandHeldOptions empty = options;
    Image plate = film.pictures[0];
    {
        static const Actor actor = readActor(assetFolder() / "actor", "woman");
        std::vector<MotionFrame> aside = oneTake(1, kTakeDistance);
        aside[0].trans[0] = 30;
        const Performer performer{&actor, aside};
        empty.width = 225, empty.height = 400;
        filmHandHeld(testDevice(), {&performer, 1}, film.folder / "empty.mp4", film.folder / "none",
                     empty);
        VideoReader video(film.folder / "empty.mp4");
        Image picture;
        ASSERT_TRUE(video.next(picture));
        for (int y = 0; y < 400; ++y) std::copy_n(picture.row(y), plate.rowBytes(), plate.row(y));
    }
    writeImage(film.folder / "plate.png", plate);
    ClipCutter cutter(film.folder / "plate.png");
    film.learn(cutter);
    EXPECT_EQ(cutter.source(), "the plate plate.png");
    ClipCutter without("");
    film.learn(without);
    EXPECT_GT(film.iou(cutter), film.iou(without));
    EXPECT_GT(film.iou(cutter), .94);

    // Another scene, another shape, no picture.
    Image noise(225, 400, 3);
    for (size_t i = 0; i < noise.data.size(); ++i)
        noise.data[i] = uint8_t(256 * uniformOf(5, i / 300));
    writeImage(film.folder / "noise.png", noise);
    const auto refusal = [&](const char* name) {
        return messageOf<InputError>([&] {
            ClipCutter wrong(film.folder / name);
            film.learn(wrong);
        });
    };
    EXPECT_NE(refusal("noise.png").find("noise.png: expected what the frames show without"),
              std::string::npos);
    writeImage(film.folder / "wide.png", Image(400, 225, 3, 90));
    EXPECT_NE(refusal("wide.png").find("wide.png: expected a picture as wide and high"),
              std::string::npos);
    film.folder.write("text.png", std::string("?"));
    EXPECT_NE(refusal("text.png").find("text.png"), std::string::npos);
}

TEST(StillBackground, ShadowsAreBackground) {
    Image wall(40, 30, 3);
    for (size_t i = 0; i < wall.data.size(); ++i) wall.data[i] = uint8_t(120 + (i * 7) % 40);
    StillBackground background;
    background.set(wall);
    Image now = wall;
    for (int x = 0; x < 10; ++x)
        for (size_t c = 0; c < 3; ++c) {
            now.pixel(x, 5)[c] = uint8_t(.8 * now.pixel(x, 5)[c]);  // a shadow
            now.pixel(x, 9)[c] = uint8_t(c == 0 ? 230 : 40);        // somebody's sleeve
        }
    const auto favour = background.favour(now, std::vector<float>(1200), {0, 0, 40, 30});
    EXPECT_LT(favour[20 * 40 + 5], -2);
    EXPECT_LT(favour[5 * 40 + 4], 1);
    EXPECT_GT(favour[9 * 40 + 4], 3);
}

}  // namespace
}  // namespace doppel
