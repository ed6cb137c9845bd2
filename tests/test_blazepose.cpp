// BlazePose against what TensorFlow Lite and the official solution made of the same pictures. The
// networks are fetched by scripts/setup --models; without them tests that run one are skipped.
#include "trainer/person/blazepose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/numbers.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/person/tracker.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

const fs::path kData = test::sourceFolder() / "tests/data/blazepose";

#define NEEDS_MODELS(net)                                                \
    if (!poseModelsAreThere(net, test::sourceFolder() / "build/models")) \
    GTEST_SKIP() << "scripts/setup --models fetches the networks"

BlazePose blazePose(PoseNet net) {
    return BlazePose(testDevice(), net, test::sourceFolder() / "build/models");
}

// Little-endian numbers, of single or half precision by the file's name.
std::vector<float> numbers(const std::string& name) {
    const std::vector<uint8_t> bytes = readWholeFile(kData / name);
    const bool half = name.ends_with(".f16");
    std::vector<float> values(bytes.size() / (half ? 2 : 4));
    for (size_t i = 0; i < values.size(); ++i) {
        values[i] =
            half ? halfToFloat(loadAt<uint16_t>(bytes.data(), i)) : loadAt<float>(bytes.data(), i);
    }
    return values;
}

nlohmann::json json(const fs::path& file) { return nlohmann::json::parse(std::ifstream(file)); }

double largestDifference(const std::vector<float>& a, const std::vector<float>& b) {
    EXPECT_EQ(a.size(), b.size());
    double most = 0;
    for (size_t i = 0; i < std::min(a.size(), b.size()); ++i)
        most = std::max(most, std::abs(double(a[i]) - double(b[i])));
    return most;
}

// The largest difference, less what b lost when it was rounded to half precision.
double beyondHalf(const std::vector<float>& a, const std::vector<float>& b) {
    EXPECT_EQ(a.size(), b.size());
    double most = 0;
    for (size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
        const double lost = std::ldexp(std::max(std::abs(double(b[i])), 1e-4), -11);
        most = std::max(most, std::abs(double(a[i]) - double(b[i])) - lost);
    }
    return most;
}

std::vector<float> planes(const Image& image) {
    return crop(image, roiOfPicture(image.width, image.height), image.width, Outside::Edge);
}

TEST(BlazePose, TheDetectorIsTensorFlowLites) {
    NEEDS_MODELS(PoseNet::Lite);
    BlazePose pose = blazePose(PoseNet::Lite);
    const auto [boxes, scores] = pose.runDetector(planes(readImage(kData / "det_input_224.png")));
    const double ofBoxes = largestDifference(boxes, numbers("pose_detection.boxes.f32"));
    const double ofScores = largestDifference(scores, numbers("pose_detection.scores.f32"));
    RecordProperty("boxes", std::to_string(ofBoxes));
    RecordProperty("scores", std::to_string(ofScores));
    EXPECT_LT(ofBoxes, 1e-3);
    EXPECT_LT(ofScores, 1e-3);
}

TEST(BlazePose, TheLandmarksAreTensorFlowLites) {
    for (PoseNet net : {PoseNet::Lite, PoseNet::Full, PoseNet::Heavy}) {
        NEEDS_MODELS(net);
        BlazePose pose = blazePose(net);
        const auto raw = pose.runLandmarks(planes(readImage(kData / "lm_input_256.png")));
        const std::string name = std::string("pose_landmark_") + poseNetName(net) + ".";
        // The third of five is the depth: farther than a picture is wide, and less sure.
        const std::vector<float> points = numbers(name + "landmarks195.f32");
        ASSERT_EQ(raw[0].size(), points.size());
        for (size_t k = 0; k < points.size(); ++k)
            EXPECT_NEAR(raw[0][k], points[k], k % 5 == 2 ? 2e-3 : 1e-3) << name << k;
        EXPECT_LT(largestDifference(raw[1], numbers(name + "presence.f32")), 1e-5) << name;
        EXPECT_LT(largestDifference(raw[4], numbers(name + "world117.f32")), 1e-4) << name;
        // Kept in half precision, heat maps pixel by pixel.
        EXPECT_LT(beyondHalf(raw[2], numbers(name + "mask_logits.f16")), .2) << name;
        const std::vector<float> heat = numbers(name + "heatmap_logits.f16");
        std::vector<float> turned(heat.size());
        for (size_t p = 0; p < 64 * 64; ++p)
            for (size_t c = 0; c < landmark::kAll; ++c)
                turned[c * 64 * 64 + p] = heat[p * landmark::kAll + c];
        EXPECT_LT(beyondHalf(raw[3], turned), 1e-3) << name;
    }
}

Roi roiFrom(const nlohmann::json& roi) {
    return {{roi.at("cx"), roi.at("cy")}, roi.at("size"), roi.at("rotation")};
}

// From the picture to detection, square, landmarks and mask.
TEST(BlazePose, APictureEndToEnd) {
    const Image scene = readImage(kData / "scene_512.png");
    const double size = scene.width;
    int complexity = 0;
    for (PoseNet net : {PoseNet::Lite, PoseNet::Full, PoseNet::Heavy}) {
        NEEDS_MODELS(net);
        BlazePose pose = blazePose(net);
        const auto want = json(kData / fmt::format("scene_c{}.json", complexity)).at("tflite");
        const std::vector<Detection> people = pose.detect(scene);
        ASSERT_FALSE(people.empty());
        EXPECT_NEAR(people[0].score, want.at("detection").at("score").get<double>(), 1e-4);
        for (size_t k = 0; k < 4; ++k)
            for (size_t i : {0u, 1u}) {
                const double at = want.at("detection").at("keypoints_norm")[k][i];
                EXPECT_NEAR(people[0].keypoints[k][i], at * size, .01);
            }
        const Roi roi = people[0].roi(), wanted = roiFrom(want.at("roi_px"));
        EXPECT_NEAR(roi.centre[0], wanted.centre[0], .01);
        EXPECT_NEAR(roi.centre[1], wanted.centre[1], .01);
        EXPECT_NEAR(roi.side, wanted.side, .05);
        EXPECT_NEAR(roi.rotation, wanted.rotation, 1e-4);

        // Heat maps make jumps of tiny differences, so medians are compared.
        const PersonLandmarks person = pose.landmarks(scene, wanted);
        EXPECT_NEAR(person.presence, want.at("presence").get<double>(), 1e-3);
        std::vector<double> off;
        for (size_t i = 0; i < landmark::kAll; ++i) {
            const auto& at = want.at("landmarks_xyzvp")[i];
            off.push_back(std::hypot(person.points[i].picture[0] - at[0].get<double>() * size,
                                     person.points[i].picture[1] - at[1].get<double>() * size));
            EXPECT_NEAR(person.points[i].visibility, at[3].get<double>(), .01) << i;
            for (size_t k = 0; k < 3; ++k)
                EXPECT_NEAR(person.points[i].world[k], want.at("world_xyz")[i][k].get<double>(),
                            2e-3)
                    << i;
        }
        std::nth_element(off.begin(), off.begin() + 16, off.begin() + 33);
        EXPECT_LT(off[16], .05) << poseNetName(net);
        ++complexity;
    }
}

// A picture and its mirror image show the same person, left for right, to the last bit of what
// landmarksBothWays() makes of them, and near what landmarks() does.
TEST(BlazePose, BothWaysAMirrorImageIsTheSamePerson) {
    NEEDS_MODELS(PoseNet::Lite);
    BlazePose pose = blazePose(PoseNet::Lite);
    const Image scene = readImage(kData / "scene_512.png");
    Image image = scene;
    for (int y = 0; y < scene.height; ++y)
        for (int x = 0; x < scene.width; ++x)
            std::copy_n(scene.pixel(scene.width - 1 - x, y), 3, image.pixel(x, y));
    const std::vector<Detection> people = pose.detect(scene);
    ASSERT_FALSE(people.empty());
    const Roi roi = people[0].roi();
    const Roi turned{{scene.width - roi.centre[0], roi.centre[1]}, roi.side, -roi.rotation};
    const PersonLandmarks one = pose.landmarks(scene, roi);
    const PersonLandmarks person = pose.landmarksBothWays(scene, roi);
    const PersonLandmarks other = pose.landmarksBothWays(image, turned);
    const double mid = scene.width;
    double moved = 0;
    for (size_t i = 0; i < landmark::kCount; ++i) {
        const Landmark &a = person.points[i], &b = other.points[oppositeLandmark(i)];
        EXPECT_NEAR(a.picture[0], mid - b.picture[0], .05) << i;
        EXPECT_NEAR(a.picture[1], b.picture[1], .05) << i;
        EXPECT_NEAR(a.world[0], -b.world[0], 1e-3) << i;
        EXPECT_NEAR(a.world[2], b.world[2], 1e-3) << i;
        moved += (a.picture[0] - one.points[i].picture[0]) / 33;
    }
    // Neither is to one side of the other.
    EXPECT_LT(std::abs(moved), .02 * roi.side / 4);
    double off = 0;
    for (int y = 0; y < kRoiMaskSide; ++y)
        for (int x = 0; x < kRoiMaskSide; ++x)
            off += std::abs(person.mask[size_t(y * kRoiMaskSide + x)] -
                            other.mask[size_t(y * kRoiMaskSide + kRoiMaskSide - 1 - x)]) /
                   (kRoiMaskSide * kRoiMaskSide);
    EXPECT_LT(off, .05);

    // Mirrored twice is as it was.
    const PersonLandmarks twice = mirrored(mirrored(one));
    for (size_t i = 0; i < landmark::kCount; ++i)
        for (size_t k = 0; k < 3; ++k) {
            EXPECT_NEAR(twice.points[i].picture[k], one.points[i].picture[k], 1e-9);
            EXPECT_NEAR(twice.points[i].world[k], one.points[i].world[k], 1e-12);
        }
    EXPECT_EQ(twice.mask, one.mask);
}

// A film of a real person, which is not ours to give: read from the data folder beside the source.
const fs::path kShared = test::sourceFolder() / "../shared/data";

TEST(BlazePose, PicturesGiveTheOfficialLandmarks) {
    const fs::path folder = kShared / "blazepose/official";
    std::error_code error;
    if (!fs::is_directory(folder, error)) GTEST_SKIP() << "the pictures are not there";
    for (int complexity : {0, 1, 2}) {
        const PoseNet net =
            std::array{PoseNet::Lite, PoseNet::Full, PoseNet::Heavy}[size_t(complexity)];
        NEEDS_MODELS(net);
        BlazePose pose = blazePose(net);
        double mean = 0;
        size_t count = 0;
        for (const auto& entry : fs::directory_iterator(folder)) {
            const auto want = json(entry.path());
            if (want.at("complexity") != complexity) continue;
            const std::string name = want.at("image");
            const fs::path images =
                kShared / "retargeting" / (name.starts_with("box") ? "box" : "8-views") / "images";
            const Image picture = readImage(images / (name.substr(name.find('_') + 1) + ".jpg"));
            const PersonLandmarks person = pose.landmarks(picture, roiFrom(want.at("roi_px")));
            for (size_t i = 0; i < landmark::kCount; ++i, ++count) {
                const auto& at = want.at("landmarks_xyzv")[i];
                mean +=
                    std::hypot(person.points[i].picture[0] - at[0].get<double>() * picture.width,
                               person.points[i].picture[1] - at[1].get<double>() * picture.height);
            }
        }
        ASSERT_GT(count, 0u);
        mean /= double(count);
        std::cout << poseNetName(net) << ": mean " << mean << " px\n";
        EXPECT_LT(mean, .2);
    }
}

TEST(BlazePose, ATrackIsTheOfficialOne) {
    NEEDS_MODELS(PoseNet::Full);
    const fs::path file = kShared / "blazepose/track_box_c1.json";
    std::error_code error;
    if (!fs::exists(file, error)) GTEST_SKIP() << "the film is not there";
    BlazePose pose = blazePose(PoseNet::Full);
    std::vector<fs::path> pictures;
    for (const auto& entry : fs::directory_iterator(kShared / "retargeting/box/images"))
        pictures.push_back(entry.path());
    std::ranges::sort(pictures);
    const auto frames = json(file).at("frames");
    Track track;
    std::vector<double> times;
    double side = 0;
    RoiFilter filter;
    for (size_t f = 0; f < frames.size(); ++f) {
        const auto& roi = frames[f].at("roi_px");
        const Image picture = readImage(pictures.at(f));
        times.push_back(double(f + 1) / 30);
        const Roi official{{roi[0], roi[1]}, roi[2], roi[3]};
        track.push_back(pose.landmarks(picture, official));
        // The square of the next picture comes from this one's landmarks.
        const Roi next = filter(*track.back(), 1. / 30);
        if (f + 1 < frames.size())
            side += std::abs(next.side - frames[f + 1].at("roi_px")[2].get<double>()) / 119;
    }
    EXPECT_LT(side, 1.);
    smoothForward(track, times);
    std::vector<double> off;
    for (size_t f = 0; f < track.size(); ++f)
        for (size_t i = 0; i < landmark::kCount; ++i) {
            const auto& at = frames[f].at("landmarks_xyzv")[i];
            off.push_back(std::hypot(track[f]->points[i].picture[0] - at[0].get<double>() * 1000,
                                     track[f]->points[i].picture[1] - at[1].get<double>() * 1080));
        }
    double mean = 0;
    for (double d : off) mean += d / double(off.size());
    std::cout << "mean " << mean << " px, next square's side " << side << " px\n";
    EXPECT_LT(mean, .3);
}

TEST(BlazePose, LeftAndRight) {
    using namespace landmark;
    for (const auto& [left, right] : {std::pair{kLeftEye, kRightEye},
                                      {kLeftEar, kRightEar},
                                      {kMouthLeft, kMouthRight},
                                      {kLeftWrist, kRightWrist},
                                      {kLeftFootTip, kRightFootTip}}) {
        EXPECT_EQ(oppositeLandmark(left), right);
        EXPECT_EQ(oppositeLandmark(right), left);
    }
    EXPECT_EQ(oppositeLandmark(kNose), kNose);
    EXPECT_EQ(oppositeLandmark(1), 4u);
}

TEST(BlazePose, MissingNetworksAreNamed) {
    BlazePose pose(testDevice(), PoseNet::Full, "/nowhere");
    expectInputError([&] { pose.requireModels(); }, "scripts/setup --models");
    expectInputError([] { poseNetByName("huge", "--pose"); },
                     "--pose: expected lite, full or heavy, found \"huge\"");
}

TEST(OneEuro, RestsAndFollows) {
    OneEuro filter({.05, 80});
    EXPECT_EQ(filter(5, 1, 100), 5);
    double value = 0;
    for (int i = 0; i < 30; ++i) value = filter(5 + (i % 2 ? .5 : -.5), 1. / 30, 100);
    EXPECT_NEAR(value, 5, .2);  // a tremor of half a pixel is mostly gone
    for (int i = 0; i < 30; ++i) value = filter(5 + 10. * i, 1. / 30, 100);
    EXPECT_NEAR(value, 295, 3);  // and a quick motion is followed
}

// Landmarks that move across, in pictures ten a second; nobody in one of them.
Track moving() {
    Track track(21);
    for (size_t f = 0; f < track.size(); ++f) {
        if (f == 10) continue;
        track[f].emplace();
        for (size_t i = 0; i < landmark::kAll; ++i) {
            Landmark& point = track[f]->points[i];
            const double sign = i % 2 ? 1 : -1;
            point.picture = {100. + 5. * double(f) + 30 * sign, 10. * double(i), 0};
            point.world = {sign * .2, double(i) * .01, 0};
            point.visibility = 1;
        }
    }
    return track;
}

std::vector<double> tenths(size_t count) {
    std::vector<double> times;
    for (size_t f = 0; f < count; ++f) times.push_back(double(f) / 10);
    return times;
}

TEST(Track, BothWaysThereIsNoLag) {
    const Track track = moving();
    Track forward = track, both = track;
    smoothForward(forward, tenths(21));
    smoothBothWays(both, tenths(21));
    EXPECT_FALSE(both[10]);
    const auto lag = [&](const Track& smoothed, size_t f) {
        return track[f]->points[15].picture[0] - smoothed[f]->points[15].picture[0];
    };
    EXPECT_GT(lag(forward, 5), .2);
    EXPECT_LT(std::abs(lag(both, 5)), .2 * lag(forward, 5));
    EXPECT_EQ(lag(forward, 11), 0);  // it begins anew
    forward = track;
    smoothForward(forward, tenths(21), {4});
    EXPECT_EQ(lag(forward, 4), 0);
}

TEST(Track, SwapsAreMended) {
    const Track track = moving();
    Track swapped = track;
    for (size_t f : {5u, 6u, 15u})
        for (size_t i = 1; i < landmark::kCount; ++i)
            if (oppositeLandmark(i) > i)
                std::swap(swapped[f]->points[i], swapped[f]->points[oppositeLandmark(i)]);
    EXPECT_EQ(mendSwaps(swapped), 3u);
    for (size_t f : {5u, 6u, 15u})
        EXPECT_EQ(swapped[f]->points[15].picture, track[f]->points[15].picture);
    EXPECT_EQ(mendSwaps(swapped), 0u);
}

TEST(Roi, GoesThereAndBack) {
    const Roi roi = roiOfBody({100, 200}, {130, 80});
    EXPECT_NEAR(roi.side, 2.5 * std::hypot(30, 120), 1e-9);
    EXPECT_NEAR(roi.rotation, std::atan2(30, 120), 1e-9);
    const Point2 there = roi.toPicture({.2, .9}), back = roi.fromPicture(there);
    EXPECT_NEAR(back[0], .2, 1e-9);
    EXPECT_NEAR(back[1], .9, 1e-9);
    // The scale point is straight above the middle.
    EXPECT_NEAR(roi.fromPicture({130, 80})[0], .5, 1e-9);
    EXPECT_LT(roi.fromPicture({130, 80})[1], .5);
}

}  // namespace
}  // namespace doppel
