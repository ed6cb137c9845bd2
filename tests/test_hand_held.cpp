// Synthetic clips and their truth, and the figures that compare a capture with one.
#include "trainer/motion/hand_held.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "engine/error.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/body_render.h"
#include "trainer/data/capture_writer.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/eval/metrics.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

const Actor& woman() {
    static const Actor actor = readActor(assetFolder() / "actor", "woman");
    return actor;
}

HandHeldOptions small() {
    HandHeldOptions options;
    options.width = 135, options.height = 240;
    return options;
}

// Frames of the take, a tenth of it apart.
std::vector<MotionFrame> takeOf(int frames, float distance = kTakeDistance) {
    return oneTake(frames, distance);
}

std::vector<Image> picturesOf(const fs::path& clip) {
    VideoReader video(clip);
    std::vector<Image> pictures;
    for (Image picture; video.next(picture);) pictures.push_back(picture);
    return pictures;
}

// Means of a picture's channels over its upper corners, where nobody is.
std::array<double, 3> cornersOf(const Image& picture) {
    std::array<double, 3> mean{};
    double count = 0;
    for (int y = 0; y < picture.height / 6; ++y)
        for (int x = 0; x < picture.width; ++x, ++count)
            for (size_t c = 0; c < 3; ++c) mean[c] += picture.pixel(x, y)[c];
    for (double& value : mean) value /= count;
    return mean;
}

TEST(OneTake, TurnsOnceAndDoesNotJump) {
    const std::vector<MotionFrame> take = oneTake(240, 2);
    ASSERT_EQ(take.size(), 240u);
    double turned = 0;
    for (size_t f = 1; f < take.size(); ++f) {
        const glm::dquat step =
            glm::inverse(jointRotation(take[f - 1].theta, 0)) * jointRotation(take[f].theta, 0);
        turned += axisAngleOf(step).y;
        for (size_t j = 0; j < joint::kCount; ++j) {
            const glm::dquat change =
                glm::inverse(jointRotation(take[f - 1].theta, j)) * jointRotation(take[f].theta, j);
            EXPECT_LT(glm::length(axisAngleOf(change)), .2) << jointName(j) << " in " << f;
        }
    }
    EXPECT_NEAR(turned, 2 * M_PI, 1e-3);
}

TEST(HandHeld, TheTruthIsWhatIsSeen) {
    Folder folder;
    const Performer performer{&woman(), takeOf(8)};
    filmHandHeld(testDevice(), {&performer, 1}, folder / "clip.mp4", folder / "truth", small());
    const std::vector<Image> pictures = picturesOf(folder / "clip.mp4");
    ASSERT_EQ(pictures.size(), 8u);
    EXPECT_EQ(pictures[0].height, 240);
    EXPECT_NEAR(VideoReader(folder / "clip.mp4").framesPerSecond(), 30, 1e-6);

    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const ClipTruth truth = readClipTruth(folder / "truth", body);
    const Poses poses = readPoses(folder / "truth/poses.npz", true);
    const Cameras cameras = readCameras(folder / "truth/cameras.npz", 8);
    ASSERT_EQ(truth.names.size(), 8u);
    EXPECT_EQ(truth.names[3], "000003");
    BodyPoser poser(testDevice(), woman().body);
    MeshDrawer drawer(testDevice(), woman().body);
    for (size_t f = 0; f < 8; ++f) {
        const PosedMesh posed = poser.pose(poses.theta[f], poses.trans[f], {});
        const Image mask = readMask(truth.masks[f]);
        EXPECT_GT(intersectionOverUnion(drawer.mask(posed.verts, cameras.cameras[f]), mask.data),
                  .96);
        for (size_t j = 0; j < joint::kCount; ++j) {
            const auto& at = posed.joints[j];
            EXPECT_LT(glm::length(truth.joints[f][j] - glm::dvec3(at[0], at[1], at[2])), 1e-4);
        }
        // Whole in the picture, and large.
        const auto inside = std::ranges::count_if(mask.data, [](uint8_t v) { return v > 0; });
        EXPECT_GT(double(inside) / double(mask.data.size()), .05) << f;
        for (int x = 0; x < mask.width; ++x) EXPECT_EQ(mask.row(0)[x] + mask.row(239)[x], 0) << f;
        for (int y = 0; y < mask.height; ++y)
            EXPECT_EQ(mask.row(y)[0] + mask.row(y)[mask.width - 1], 0) << f;
    }
    EXPECT_FALSE(poses.trans[1] == poses.trans[0]);  // the hand shakes
}

TEST(HandHeld, HandsShakeAndExposuresDrift) {
    Folder folder;
    HandHeldOptions options = small();
    options.fps = 2;  // seconds go by
    const auto film = [&](const char* name) {
        const Performer performer{&woman(), takeOf(5)};
        filmHandHeld(testDevice(), {&performer, 1}, folder / (name + std::string(".mp4")),
                     folder / name, options);
        return picturesOf(folder / (name + std::string(".mp4")));
    };
    const std::vector<Image> moved = film("moved");
    film("again");
    EXPECT_EQ(test::bytesOf(folder / "moved.mp4"), test::bytesOf(folder / "again.mp4"));
    options.still = true;
    const std::vector<Image> still = film("still");
    double drift = 0, rest = 0;
    for (size_t f = 1; f < 5; ++f)
        for (size_t c = 0; c < 3; ++c) {
            drift = std::max(drift, std::abs(cornersOf(moved[f])[c] - cornersOf(moved[0])[c]));
            rest = std::max(rest, std::abs(cornersOf(still[f])[c] - cornersOf(still[0])[c]));
        }
    EXPECT_GT(drift, 4);
    EXPECT_LT(rest, 1.5);
}

TEST(HandHeld, WhoIsNearerHidesTheOthers) {
    Folder folder;
    std::vector<MotionFrame> near = takeOf(1, 1.9f);
    const std::vector<MotionFrame> far = takeOf(1, 2.8f);
    near[0].trans[0] = .15f;
    const auto seen = [&](std::vector<Performer> performers) {
        filmHandHeld(testDevice(), performers, folder / "clip.mp4", folder / "truth", small());
        const Image mask = readMask(folder / "truth/masks/000000.png");
        return std::ranges::count_if(mask.data, [](uint8_t v) { return v > 0; });
    };
    const auto alone = seen({{&woman(), far}});
    const auto hidden = seen({{&woman(), far}, {&woman(), near}});
    EXPECT_LT(hidden, alone * 3 / 4);
    EXPECT_GT(hidden, 0);
    EXPECT_EQ(seen({{&woman(), near}, {&woman(), far}}), seen({{&woman(), near}}));
}

// ---- figures ------------------------------------------------------------------------------------

// A capture of two frames with masks, and the same as a truth.
struct Known {
    Folder folder;
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    Capture capture;

    Known() {
        const std::vector<MotionFrame> take = oneTake(2, 2);
        CaptureWriter writer(folder / "truth");
        Capture made;
        std::vector<uint8_t> rgb(20 * 30 * 3, 90), mask(20 * 30);
        for (size_t i = 0; i < 300; ++i) mask[i] = 255;
        for (size_t f = 0; f < 2; ++f) {
            Frame frame;
            frame.name = fmt::format("{:06}", 3 * f);
            frame.camera = {30, 30, 10, 15, 20, 30};
            writer.addImage(frame.name, 20, 30, rgb);
            writer.addMask(frame.name, 20, 30, mask);
            made.frames.push_back(frame);
            made.theta.push_back(take[f].theta);
            made.trans.push_back(take[f].trans);
        }
        capture = writer.commit(made);
    }
};

TEST(ClipTruth, AnErrorIsAsLargeAsItIs) {
    Known known;
    const ClipTruth truth = readClipTruth(known.folder / "truth", known.body);
    const auto exact = compareWithTruth(known.capture, truth, known.body);
    ASSERT_EQ(exact.size(), 2u);
    EXPECT_LT(exact[0].joints, 1e-3);
    EXPECT_LT(exact[0].pelvis, 1e-3);
    EXPECT_EQ(exact[1].name, "000003");
    EXPECT_EQ(exact[1].iou, 1.);
    // Whoever stands 30 mm aside has the same joints about the pelvis.
    Capture moved = known.capture;
    moved.trans[0][0] += .03f;
    const auto aside = compareWithTruth(moved, truth, known.body);
    EXPECT_LT(aside[0].joints, 1e-3);
    EXPECT_NEAR(aside[0].pelvis, 30, 1e-2);
    // A forearm that is turned moves one wrist of twelve joints.
    Capture turned = known.capture;
    turned.theta[0][3 * joint::kLeftElbow + 1] -= .5f;
    const auto places = [&](const Capture& c) {
        return jointPlaces(known.body, c.betas, c.theta[0], c.trans[0]);
    };
    const double off = 1000 * glm::length(places(turned)[joint::kLeftWrist] -
                                          places(known.capture)[joint::kLeftWrist]);
    const auto bent = compareWithTruth(turned, truth, known.body);
    EXPECT_GT(off, 80);
    EXPECT_NEAR(bent[0].joints, off / 12, 1e-3);
    // A body that is turned as a whole is right once it is turned back.
    Capture whole = known.capture;
    setJointRotation(whole.theta[0], 0,
                     jointRotation(whole.theta[0], 0) * quaternionOf({0, .4, 0}));
    const auto spun = compareWithTruth(whole, truth, known.body);
    EXPECT_GT(spun[0].joints, 40);
    EXPECT_LT(spun[0].aligned, 1e-3);
    // Masks: half of the person is missing.
    std::vector<uint8_t> rest(20 * 30);
    for (size_t i = 0; i < 150; ++i) rest[i] = 255;
    CaptureWriter writer(known.folder / "half");
    for (const Frame& frame : known.capture.frames) {
        writer.copyImage(frame.name, frame.image);
        writer.addMask(frame.name, 20, 30, rest);
    }
    EXPECT_EQ(compareWithTruth(writer.commit(known.capture), truth, known.body)[0].iou, .5);
}

TEST(ClipTruth, WhatIsWrongIsSaid) {
    Known known;
    EXPECT_NE(messageOf<InputError>([&] {
                  readClipTruth(known.folder.path(), known.body);
              }).find("expected a truth, masks/ and poses.npz (docs/formats.md"),
              std::string::npos);
    const fs::path poses = known.folder / "truth/poses.npz";
    Npz arrays = readNpz(poses);
    std::vector<float> joints(2 * 72, 1.f);
    joints[75] = NAN;
    arrays.set("joints", Array::f32({2, 24, 3}, joints));
    writeNpz(poses, arrays, false);
    EXPECT_NE(messageOf<InputError>([&] {
                  readClipTruth(known.folder / "truth", known.body);
              }).find("poses.npz: joints"),
              std::string::npos);
    joints.resize(72);
    arrays.set("joints", Array::f32({1, 24, 3}, joints));
    writeNpz(poses, arrays, false);
    EXPECT_NE(messageOf<InputError>([&] {
                  readClipTruth(known.folder / "truth", known.body);
              }).find("joints"),
              std::string::npos);
    fs::remove(known.folder / "truth/masks/000003.png");
    EXPECT_NE(messageOf<InputError>([&] {
                  readClipTruth(known.folder / "truth", known.body);
              }).find("expected poses of 1 frames, as many as masks/ has, found 2"),
              std::string::npos);
    Known other;
    const ClipTruth truth = readClipTruth(other.folder / "truth", other.body);
    for (Frame& frame : other.capture.frames) frame.name = "x" + frame.name;
    EXPECT_NE(messageOf<InputError>([&] {
                  compareWithTruth(other.capture, truth, other.body);
              }).find("expected frames with names of the truth's (000000 to 000003), found none"),
              std::string::npos);
}

}  // namespace
}  // namespace doppel
