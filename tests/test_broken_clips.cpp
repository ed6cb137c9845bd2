// Clips as they come: damaged, cut off, empty of people, too large, of varying rate, of high
// dynamic range. Each gives a capture that says what is wrong with it, or one sentence.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/import/import.h"
#include "trainer/motion/hand_held.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

const fs::path kClips = test::sourceFolder() / "tests/data/clips";
const fs::path kModels = test::sourceFolder() / "build/models";

#define NEEDS_MODELS()                               \
    if (!poseModelsAreThere(PoseNet::Lite, kModels)) \
    GTEST_SKIP() << "scripts/setup --models fetches the networks"

BodyPicture noBody(const Camera& camera, const Theta&, const Trans&, const Betas&) {
    return {std::vector<uint8_t>(size_t(camera.width) * size_t(camera.height)), {}};
}

Capture import(const fs::path& source, const fs::path& out, const ClipOptions& clip = {}) {
    static const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    ImportSettings settings;
    settings.request.source = source;
    settings.request.clip = clip;
    settings.request.net = PoseNet::Lite;
    settings.request.device = &testDevice();
    settings.request.body = &body;
    settings.out = out;
    settings.overlays = false;
    return importCapture(settings, noBody).capture;
}

// The woman of the cast, so many frames of the take, moved aside by metres.
std::vector<Image> film(const Folder& folder, int frames, float aside = 0) {
    static const Actor actor = readActor(assetFolder() / "actor", "woman");
    std::vector<MotionFrame> take = oneTake(30, kTakeDistance);
    take.resize(size_t(frames));
    for (MotionFrame& frame : take) frame.trans[0] += aside;
    HandHeldOptions options;
    options.width = 270, options.height = 480;
    const Performer performer{&actor, take};
    filmHandHeld(testDevice(), {&performer, 1}, folder / "film.mp4", folder / "truth", options);
    VideoReader video(folder / "film.mp4");
    std::vector<Image> pictures;
    for (Image picture; video.next(picture);) pictures.push_back(picture);
    return pictures;
}

fs::path write(const fs::path& file, const std::vector<Image>& pictures, double rate = 30) {
    VideoWriter video(file, pictures[0].width, pictures[0].height, rate);
    for (const Image& picture : pictures) video.add(picture);
    video.finish();
    return file;
}

std::string said(const Capture& capture, const char* what) {
    const auto at = capture.source.find(what);
    return at == capture.source.end() ? "" : at->second;
}

TEST(BrokenClip, HighDynamicRangeBecomesSrgb) {
    const auto first = [](const char* name) {
        VideoReader video(kClips / name);
        Image picture;
        EXPECT_TRUE(video.next(picture));
        return std::pair{std::string(video.highRange()), picture};
    };
    const auto [none, plain] = first("ten-bit.mp4");
    EXPECT_EQ(none, "");
    for (const auto& [name, range] : {std::pair{"hlg.mp4", "HLG"}, {"pq.mp4", "PQ"}}) {
        const auto [said, picture] = first(name);
        EXPECT_EQ(said, range);
        double off = 0, bias = 0;
        for (size_t i = 0; i < plain.data.size(); ++i) {
            const double d = double(picture.data[i]) - double(plain.data[i]);
            off += std::abs(d) / double(plain.data.size());
            bias += d / double(plain.data.size());
        }
        std::cout << name << " is " << off << " off\n";
        EXPECT_LT(off, 7) << name;  // signals taken as they are: 10 and 20
        EXPECT_LT(std::abs(bias), 5) << name;
    }
}

TEST(BrokenClip, WideColoursOfStandardRangeBecomeSrgb) {
    const auto first = [](const char* name) {
        VideoReader video(kClips / name);
        Image picture;
        EXPECT_TRUE(video.next(picture));
        EXPECT_STREQ(video.highRange(), "");
        return picture;
    };
    const Image plain = first("ten-bit.mp4");
    for (const char* name : {"p3.mp4", "bt2020.mp4"}) {
        const Image picture = first(name);
        ASSERT_EQ(picture.data.size(), plain.data.size());
        double off = 0, strong = 0, count = 0;
        for (size_t i = 0; i < plain.data.size(); i += 3) {
            const auto [least, most] = std::ranges::minmax(std::span(plain.data).subspan(i, 3));
            const bool isStrong = most - least > 60;
            count += isStrong;
            for (size_t c = i; c < i + 3; ++c) {
                const double d = std::abs(double(picture.data[c]) - double(plain.data[c]));
                off += d / double(plain.data.size());
                if (isStrong) strong += d / 3;
            }
        }
        std::cout << name << " is " << off << " off, " << strong / count << " of " << count
                  << " strong pixels\n";
        EXPECT_LT(off, 2.7) << name;           // signals taken as they are: 3.4 and 5.1
        EXPECT_LT(strong / count, 4) << name;  // 6.2 and 10.1
    }
}

TEST(BrokenClip, AHighRangeFilmIsImportedAndSaidToBe) {
    NEEDS_MODELS();
    Folder folder;
    const Capture capture = import(kClips / "hlg.mp4", folder / "out");
    EXPECT_EQ(capture.size(), 4u);
    EXPECT_EQ(said(capture, "range"), "HLG, high dynamic range, brought to sRGB");
}

TEST(BrokenClip, ARateThatVariesKeepsItsTimes) {
    const auto frames = surveyClip(kClips / "vfr.mp4", {});
    const std::vector<double> times{0, .1, .2, .3, .6, .9, 1.2, 1.5};
    ASSERT_EQ(frames.size(), times.size());
    for (size_t f = 0; f < times.size(); ++f) EXPECT_NEAR(frames[f].time, times[f], 1e-3) << f;
    EXPECT_NEAR(keptRate(frames, 30), 7 / 1.5, 1e-2);
    NEEDS_MODELS();
    Folder folder;
    const Capture capture = import(kClips / "vfr.mp4", folder / "out");
    EXPECT_EQ(capture.size(), 8u);
    const std::vector<double> kept = readNpz(folder / "out/landmarks.npz").at("time").toF64();
    for (size_t f = 0; f < times.size(); ++f) EXPECT_NEAR(kept[f], times[f], 1e-3) << f;
}

TEST(BrokenClip, NobodyInIt) {
    NEEDS_MODELS();
    Folder folder;
    film(folder, 4, 30);
    EXPECT_EQ(messageOf<InputError>([&] { import(folder / "film.mp4", folder / "out"); }),
              (folder / "film.mp4").string() +
                  ": expected a person in its 4 frames, found nobody; film one person, whole and "
                  "upright, at least a third as high as the picture");
    EXPECT_FALSE(fs::exists(folder / "out"));
}

TEST(BrokenClip, NobodyInSomeFrames) {
    NEEDS_MODELS();
    Folder folder;
    const std::vector<Image> empty = film(folder, 2, 30), with = film(folder, 4);
    const std::vector<Image> pictures{with[0], with[1], empty[0], empty[1], with[2], with[3]};
    const Capture capture = import(write(folder / "some.mp4", pictures), folder / "out");
    EXPECT_EQ(capture.size(), 4u);
    EXPECT_NEAR(capture.fps, 3 / (5 / 30.), 1e-3);
    const auto left = nlohmann::json::parse(test::bytesOf(folder / "out/quality.json"))["left_out"];
    ASSERT_EQ(left.size(), 2u);
    for (size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(left[i]["frame"], 2 + i);
        EXPECT_EQ(left[i]["why"], "without the person");
    }
}

TEST(BrokenClip, APersonCutOffAtTheKnees) {
    NEEDS_MODELS();
    Folder folder;
    std::vector<Image> pictures = film(folder, 4);
    EXPECT_EQ(said(import(folder / "film.mp4", folder / "whole"), "cut_off"), "");
    for (Image& picture : pictures) {
        Image cut(270, 320, 3);
        for (int y = 0; y < cut.height; ++y)
            std::copy_n(picture.row(y), cut.rowBytes(), cut.row(y));
        picture = cut;
    }
    const Capture capture = import(write(folder / "cut.mp4", pictures), folder / "out");
    EXPECT_NE(said(capture, "cut_off").find("outside of the picture in 4 of 4 frames"),
              std::string::npos)
        << said(capture, "cut_off");
}

TEST(BrokenClip, LargeAndFast) {
    NEEDS_MODELS();
    Folder folder;
    std::vector<Image> pictures = film(folder, 4);
    for (Image& picture : pictures) {
        // In landscape: 3840×2160, the person in the middle.
        const Image high = resize(picture, 1215, 2160);
        Image wide(3840, 2160, 3, 90);
        for (int y = 0; y < wide.height; ++y)
            std::copy_n(high.row(y), high.rowBytes(), wide.pixel(1312, y));
        picture = std::move(wide);
    }
    const Capture capture = import(write(folder / "4k.mp4", pictures, 60), folder / "out");
    EXPECT_EQ(capture.size(), 4u);
    EXPECT_NEAR(capture.fps, 60, 1e-6);
    EXPECT_EQ(capture.frames[0].camera.width, 1920);
    EXPECT_EQ(capture.frames[0].camera.height, 1080);
    EXPECT_TRUE(capture.hasMasks());
}

TEST(BrokenClip, CutShort) {
    NEEDS_MODELS();
    Folder folder;
    film(folder, 20);
    const std::vector<uint8_t> whole = readWholeFile(folder / "film.mp4");
    folder.write("short.mp4", std::span(whole).first(whole.size() * 3 / 5));
    const Capture capture = import(folder / "short.mp4", folder / "out");
    EXPECT_GT(capture.size(), 4u);
    EXPECT_LT(capture.size(), 18u);
    EXPECT_NE(said(capture, "ends").find("of 0.67 s"), std::string::npos) << said(capture, "ends");
    EXPECT_NE(
        said(capture, "ends").find("short.mp4: the video is damaged or cut short after frame "),
        std::string::npos)
        << said(capture, "ends");
    // The index alone, which comes first.
    const std::string_view data = "mdat";
    const auto at = std::search(whole.begin(), whole.end(), data.begin(), data.end());
    ASSERT_NE(at, whole.end());
    folder.write("index.mp4", std::span(whole).first(size_t(at - whole.begin()) + 4));
    EXPECT_NE(messageOf<InputError>([&] {
                  import(folder / "index.mp4", folder / "none");
              }).find("index.mp4: the video is damaged"),
              std::string::npos);
    EXPECT_FALSE(fs::exists(folder / "none"));
}

// Decoders paint over what they cannot read; such pictures show nobody as they were.
TEST(BrokenClip, DamagedInTheMiddle) {
    Folder folder;
    film(folder, 20);
    const std::vector<uint8_t> whole = readWholeFile(folder / "film.mp4");
    const auto spoil = [&](size_t at) {
        std::vector<uint8_t> bytes = whole;
        std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), 64, uint8_t{255});
        folder.write("spoilt.mp4", bytes);
    };
    const std::string reason =
        (folder / "spoilt.mp4").string() + ": the video is damaged or cut short after frame ";
    for (const size_t tenths : {4u, 5u, 7u, 6u}) {
        spoil(whole.size() * tenths / 10);
        Clip clip(folder / "spoilt.mp4", {});
        int frames = 0;
        for (Image picture; clip.next(picture);) ++frames;
        EXPECT_GT(frames, 1) << tenths;
        EXPECT_LT(frames, 18) << tenths;
        EXPECT_TRUE(clip.damage().starts_with(fmt::format("{}{}: ", reason, frames)))
            << tenths << ": " << clip.damage();
    }
    NEEDS_MODELS();
    const Capture capture = import(folder / "spoilt.mp4", folder / "out");
    EXPECT_GT(capture.size(), 4u);
    EXPECT_LT(capture.size(), 18u);
    EXPECT_NE(said(capture, "ends").find(" s of 0.67 s: " + reason), std::string::npos)
        << said(capture, "ends");
}

}  // namespace
}  // namespace doppel
