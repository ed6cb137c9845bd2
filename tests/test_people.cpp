// Clips with more than one person, and what an import says of how good it is.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/eval/metrics.h"
#include "trainer/import/import.h"
#include "trainer/import/quality.h"
#include "trainer/motion/hand_held.h"
#include "trainer/person/tracker.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

const fs::path kModels = test::sourceFolder() / "build/models";

#define NEEDS_MODELS()                               \
    if (!poseModelsAreThere(PoseNet::Lite, kModels)) \
    GTEST_SKIP() << "scripts/setup --models fetches the networks"

const Actor& actor(const char* name) {
    static std::map<std::string, Actor> all;
    if (!all.contains(name)) all[name] = readActor(assetFolder() / "actor", name);
    return all[name];
}

// Somebody who stands with arms lowered and glides from one place to another, metres.
std::vector<MotionFrame> glide(int frames, double fromX, double toX, float distance) {
    std::vector<MotionFrame> motion;
    for (int i = 0; i < frames; ++i) {
        MotionFrame frame = oneTake(2, distance)[0];
        frame.theta[3 * joint::kLeftShoulder + 2] -= .4f;
        frame.theta[3 * joint::kRightShoulder + 2] += .4f;
        frame.trans[0] = float(fromX + (toX - fromX) * i / std::max(frames - 1, 1));
        motion.push_back(frame);
    }
    return motion;
}

HandHeldOptions wide() {
    HandHeldOptions options;
    options.width = 480, options.height = 360;
    options.fps = 12;
    return options;
}

// The middle of the pixels of the first performer, per frame; nothing where few are seen.
std::vector<std::optional<Point2>> middles(const fs::path& truth, int frames) {
    std::vector<std::optional<Point2>> result;
    for (int f = 0; f < frames; ++f) {
        const Image mask = readMask(truth / "masks" / fmt::format("{:06}.png", f));
        double x = 0, y = 0, count = 0;
        for (int v = 0; v < mask.height; ++v)
            for (int u = 0; u < mask.width; ++u)
                if (mask.row(v)[u]) x += u, y += v, ++count;
        result.emplace_back();
        if (count > 1500) result.back() = Point2{x / count, y / count};
    }
    return result;
}

// Follows the first performer through the clip; how many frames show the person well, in how many
// of them the person was found, and in how many somebody else was.
struct Followed {
    int shown = 0, found = 0, wrong = 0;
};

Followed follow(const std::vector<Performer>& performers, int person) {
    Folder folder;
    const int frames = int(performers[0].motion.size());
    filmHandHeld(testDevice(), performers, folder / "clip.mp4", folder / "truth", wide());
    const auto wanted = middles(folder / "truth", frames);
    BlazePose pose(testDevice(), PoseNet::Lite, kModels);
    PersonTracker tracker(pose, person);
    VideoReader video(folder / "clip.mp4");
    Followed followed;
    Image picture;
    for (int f = 0; video.next(picture); ++f) {
        const auto got = tracker.next(picture, f / 12.);
        if (wanted[size_t(f)]) ++followed.shown;
        if (!got) continue;
        const auto& hips = got->points[landmark::kCentre].picture;
        if (!wanted[size_t(f)]) continue;
        const bool right = std::abs(hips[0] - (*wanted[size_t(f)])[0]) < 30;
        ++(right ? followed.found : followed.wrong);
    }
    std::cout << "shown " << followed.shown << ", found " << followed.found << ", wrong "
              << followed.wrong << ", detections " << tracker.detections() << ", people "
              << tracker.people().size() << ", hidden " << tracker.mistaken() << "\n";
    return followed;
}

TEST(PersonTracker, WhoCrossesInFrontIsKept) {
    NEEDS_MODELS();
    const Followed f = follow(
        {{&actor("woman"), glide(30, -1, 1, 2.6f)}, {&actor("man"), glide(30, 1, -1, 3.4f)}}, 1);
    EXPECT_GE(f.found, f.shown * 9 / 10);
    EXPECT_EQ(f.wrong, 0);
}

TEST(PersonTracker, WhoCrossesBehindIsFoundAgain) {
    NEEDS_MODELS();
    const Followed f = follow(
        {{&actor("woman"), glide(30, -.9, .9, 3.1f)}, {&actor("man"), glide(30, .9, -.9, 2.6f)}},
        1);
    EXPECT_GE(f.found, f.shown * 3 / 4);
    EXPECT_LE(f.wrong, 2);
}

TEST(PersonTracker, AloneNobodyIsMistaken) {
    NEEDS_MODELS();
    const Followed f = follow({{&actor("man"), oneTake(30, 3)}}, 0);
    EXPECT_EQ(f.found, 30);
}

TEST(PersonTracker, WhomNobodySeesIsNotFollowed) {
    NEEDS_MODELS();
    EXPECT_NE(test::messageOf<InputError>([] {
                  follow({{&actor("man"), oneTake(2, 3)}}, 3);
              }).find("--person: expected 1 to 1, as many as the first picture shows, found 3"),
              std::string::npos);
}

TEST(Appearance, ClothesTellPeopleApart) {
    PersonLandmarks person;
    person.roi = {{50, 50}, 100, 0};
    person.mask.assign(size_t(kRoiMaskSide) * kRoiMaskSide, 5.f);
    const auto dressed = [](int upper, int lower) {
        Image image(100, 100, 3);
        for (int y = 0; y < 100; ++y)
            for (int x = 0; x < 100; ++x) image.pixel(x, y)[y < 50 ? upper : lower] = 200;
        return image;
    };
    const Appearance red(dressed(0, 2), person), same(dressed(0, 2), person),
        other(dressed(1, 2), person), swapped(dressed(2, 0), person);
    EXPECT_NEAR(red.likeness(same), 1, 1e-6);
    EXPECT_NEAR(red.likeness(other), .5, 1e-6);
    EXPECT_NEAR(red.likeness(swapped), 0, 1e-6);
    EXPECT_EQ(red.likeness({}), 0);
    Appearance learning = red;
    for (int i = 0; i < 100; ++i) learning.learn(other, .1);
    EXPECT_NEAR(learning.likeness(other), 1, 1e-3);
}

// ---- the report ---------------------------------------------------------------------------------

ImportSettings settingsFor(const fs::path& source, const fs::path& out, const BodyModel& body) {
    ImportSettings settings;
    settings.request.source = source;
    settings.request.net = PoseNet::Lite;
    settings.request.device = &testDevice();
    settings.request.body = &body;
    settings.out = out;
    return settings;
}

BodyPicture noBody(const Camera& camera, const Theta&, const Trans&, const Betas&) {
    return {std::vector<uint8_t>(size_t(camera.width) * size_t(camera.height)), {}};
}

TEST(ImportClip, AnImportSaysHowGoodItIs) {
    NEEDS_MODELS();
    Folder folder;
    const std::vector<Performer> performers{{&actor("woman"), glide(8, -.6, -.5, 3)},
                                            {&actor("man"), glide(8, .7, .7, 3)}};
    filmHandHeld(testDevice(), performers, folder / "clip.mp4", folder / "truth", wide());
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    ImportSettings settings = settingsFor(folder / "clip.mp4", folder / "out", body);
    settings.request.person = 1;
    const Capture capture = importCapture(settings, noBody).capture;
    ASSERT_EQ(capture.size(), 8u);
    EXPECT_NE(capture.source.at("masks").find("blazepose lite, cut out by the clip's colours"),
              std::string::npos);
    EXPECT_NE(capture.source.at("people").find("2 in the first frame, of whom number 1"),
              std::string::npos);
    EXPECT_NE(capture.source.at("quality").find("masks agree with the network's to 0."),
              std::string::npos);
    EXPECT_FALSE(capture.source.contains("cut_off"));
    const auto json = nlohmann::json::parse(test::bytesOf(folder / "out/quality.json"));
    EXPECT_EQ(json.at("frames"), 8);
    EXPECT_EQ(json.at("per_frame").size(), 8u);
    EXPECT_GT(json.at("per_frame").at("000003").at("landmarks"), .5);
    EXPECT_GT(json.at("mask_agreement"), .7);
    EXPECT_EQ(json.at("least_sure").size(), 3u);
    EXPECT_LT(json.at("mask_flicker"), .1);
    EXPECT_TRUE(json.at("per_frame").at("000000").at("mask_flicker").is_null());
    // The person is the one on the left.
    double iou = 0;
    for (const Frame& frame : capture.frames) {
        const Image mask = readMask(*frame.mask),
                    truth = readMask(folder / "truth/masks" / (frame.name + ".png"));
        iou += intersectionOverUnion(mask.data, truth.data) / 8;
    }
    EXPECT_GT(iou, .85);
    VideoReader film(folder / "out/overlay.mp4");
    EXPECT_EQ(film.width(), 480);
    Image shown;
    int count = 0;
    while (film.next(shown)) ++count;
    EXPECT_EQ(count, 8);
    const Image people = readImage(folder / "out/people.jpg");
    EXPECT_EQ(people.width, 480);
    EXPECT_FALSE(fs::exists(folder / "out/shares"));
}

// The one who is followed goes behind the other, and what is found there is not taken for her.
TEST(ImportClip, OfTwoWhoCrossOneIsKept) {
    NEEDS_MODELS();
    Folder folder;
    constexpr int kFrames = 18;
    const std::vector<Performer> performers{{&actor("woman"), glide(kFrames, -.7, .7, 3.1f)},
                                            {&actor("man"), glide(kFrames, .7, -.7, 2.6f)}};
    filmHandHeld(testDevice(), performers, folder / "clip.mp4", folder / "truth", wide());
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    ImportSettings settings = settingsFor(folder / "clip.mp4", folder / "out", body);
    settings.request.person = 1;
    settings.overlays = false;
    const Capture capture = importCapture(settings, noBody).capture;
    const size_t left = kFrames - capture.size();
    EXPECT_GT(left, 0u);
    EXPECT_LT(left, size_t{kFrames} / 2);
    EXPECT_EQ(capture.source.at("hidden"),
              fmt::format("in {} frames somebody else was found, and they are left out", left));
    const auto json = nlohmann::json::parse(test::bytesOf(folder / "out/quality.json"));
    ASSERT_EQ(json.at("left_out").size(), left);
    for (const auto& frame : json.at("left_out")) EXPECT_EQ(frame.at("why"), "without the person");
    // Before they meet and after it is her.
    for (const size_t f : {size_t{0}, size_t{1}, capture.size() - 2, capture.size() - 1}) {
        const Frame& frame = capture.frames[f];
        const Image mask = readMask(*frame.mask),
                    truth = readMask(folder / "truth/masks" / (frame.name + ".png"));
        EXPECT_GT(intersectionOverUnion(mask.data, truth.data), .85) << frame.name;
    }
}

TEST(Quality, FlickerIsWhatComesAndGoes) {
    const std::vector<uint8_t> rest{255, 255, 255, 255, 0, 0}, once{255, 255, 255, 0, 255, 0},
        moved{255, 255, 255, 0, 0, 0};
    FlickerMeter meter;
    EXPECT_FALSE(meter.next(rest));
    EXPECT_FALSE(meter.next(once));
    EXPECT_EQ(meter.next(rest), .5);    // of `once`: two of its four pixels
    EXPECT_EQ(meter.next(moved), .25);  // of `rest`: pixel 3 was there in that one only
    meter.forget();
    EXPECT_FALSE(meter.next(once));
    EXPECT_FALSE(meter.next(rest));
}

TEST(Quality, SaysWhatIsCutOff) {
    PersonLandmarks person;
    for (Landmark& point : person.points) point = {{50, 50, 0}, {}, .5, 1};
    EXPECT_NEAR(qualityOf("a", person, 100, 100).landmarks, .5, 1e-9);
    EXPECT_FALSE(qualityOf("a", person, 100, 100).cutOff);
    person.points[landmark::kLeftAnkle].picture[1] = 120;
    EXPECT_TRUE(qualityOf("a", person, 100, 100).cutOff);
    ClipQuality quality;
    for (int i = 0; i < 8; ++i) quality.frames.push_back({.name = "f", .cutOff = i == 0});
    EXPECT_EQ(cutOff(quality), "");
    quality.frames[1].cutOff = true;
    EXPECT_NE(cutOff(quality).find("outside of the picture in 2 of 8 frames"), std::string::npos);
}

}  // namespace
}  // namespace doppel
