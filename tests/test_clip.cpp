// Clips: which frames of a video or a folder are kept and how fast they play, masks led along
// edges, and from a film to a capture.
#include "trainer/import/clip.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <random>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/video.h"
#include "nn/body/body.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/frame_selection.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/import/import.h"
#include "trainer/import/masks/clip_cutter.h"
#include "trainer/motion/synthetic.h"
#include "trainer/person/body_start.h"
#include "trainer/person/masks/mask.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

// Fine checks that move, so that pictures are sharp and differ; another scene has other colours.
Image checks(int width, int height, int shift, int scene = 0) {
    Image image(width, height, 3);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const bool light = ((x + shift) / 6 + y / 6) % 2 == 0;
            uint8_t* pixel = image.pixel(x, y);
            pixel[0] = scene ? (light ? 60 : 20) : (light ? 230 : 120);
            pixel[1] = light ? 200 : 90;
            pixel[2] = scene ? 250 : 90;
        }
    return image;
}

Image smeared(const Image& image) {
    return resize(resize(image, image.width / 12, image.height / 12), image.width, image.height);
}

fs::path film(const fs::path& file, const std::vector<Image>& pictures, double rate = 20) {
    VideoWriter video(file, pictures[0].width, pictures[0].height, rate);
    for (const Image& picture : pictures) video.add(picture);
    video.finish();
    return file;
}

std::vector<Image> moving(int count, int scene = 0) {
    std::vector<Image> pictures;
    for (int i = 0; i < count; ++i) pictures.push_back(checks(96, 120, 2 * i, scene));
    return pictures;
}

std::string kept(const std::vector<ClipFrame>& frames) {
    std::string text;
    for (const ClipFrame& frame : frames)
        text += frame.fate == Fate::Kept        ? 'k'
                : frame.fate == Fate::Outside   ? '.'
                : frame.fate == Fate::Duplicate ? 'd'
                                                : 'b';
    return text;
}

TEST(Clip, TimesStepsAndRates) {
    Folder folder;
    const fs::path file = film(folder / "a.mp4", moving(12));
    EXPECT_EQ(kept(surveyClip(file, {})), "kkkkkkkkkkkk");
    EXPECT_NEAR(keptRate(surveyClip(file, {}), 1), 20, 1e-3);
    const auto third = surveyClip(file, {.every = 3});
    EXPECT_EQ(kept(third), "k..k..k..k..");
    EXPECT_NEAR(keptRate(third, 1), 20. / 3, 1e-3);
    const auto part = surveyClip(file, {.from = .2, .to = .4, .every = 2});
    EXPECT_EQ(kept(part), "....k.k.....");
    EXPECT_NEAR(keptRate(part, 1), 10, 1e-3);
    EXPECT_EQ(kept(surveyClip(file, {.frames = "2:10:4"})), "..k...k.....");
    EXPECT_EQ(keptRate(surveyClip(file, {.frames = "3"}), 7), 7);
    EXPECT_EQ(messageOf<InputError>([&] { surveyClip(file, {.from = 5}); }),
              file.string() + ": expected pictures from 5 s on, found 12 that last 0.55 s");
}

TEST(Clip, OfALongOneEnoughIsTaken) {
    Folder folder;
    const auto count = int(2 * kEnoughFrames + 1);
    const fs::path file = film(folder / "a.mp4", moving(count));
    const std::string taken = kept(surveyClip(file, {.every = 0}));
    EXPECT_EQ(taken.substr(0, 7), "k..k..k");
    EXPECT_EQ(std::ranges::count(taken, 'k'), (count + 2) / 3);
    const std::string all = kept(surveyClip(file, {}));
    EXPECT_EQ(std::ranges::count(all, 'k'), count);
    // Who names frames means them, and of few all are taken.
    EXPECT_EQ(kept(surveyClip(file, {.every = 0, .frames = "3:6"})).substr(0, 8), "...kkk..");
    EXPECT_EQ(kept(surveyClip(film(folder / "b.mp4", moving(4)), {.every = 0})), "kkkk");
}

TEST(Clip, DuplicatesBlursAndCuts) {
    Folder folder;
    std::vector<Image> pictures = moving(8);
    pictures[3] = pictures[4] = pictures[2];
    pictures[6] = smeared(pictures[6]);
    for (Image& picture : moving(4, 1)) pictures.push_back(std::move(picture));
    const fs::path file = film(folder / "a.mp4", pictures);
    const auto frames = surveyClip(file, {});
    EXPECT_EQ(kept(frames), "kkkddkbkkkkk");
    EXPECT_EQ(leftOut(frames), "2 duplicates, 1 blurred");
    EXPECT_EQ(cutsOf(frames), "0.40 s (frame 8)");
    EXPECT_NEAR(keptRate(frames, 1), 8 / .55, 1e-3);
    EXPECT_EQ(endsEarly(frames, .6), "");
    EXPECT_EQ(endsEarly(frames, 4), "at 0.55 s of 4.00 s");
    EXPECT_NEAR(Clip(file, {}).duration(), .6, 1e-3);
    EXPECT_EQ(kept(surveyClip(file, {.keepSimilar = true})), "kkkkkkkkkkkk");
}

TEST(Clip, AFolderIsLikeAVideo) {
    Folder folder;
    const std::vector<Image> pictures = moving(3);
    for (const auto& [name, i] : {std::pair{"p10.png", 2}, {"p9.jpg", 1}, {"p1.png", 0}})
        writeImage(folder / name, pictures[size_t(i)]);
    folder.write("notes.txt", std::string("not a picture"));
    Clip clip(folder.path(), {.rows = 60, .fps = 10});
    Image picture;
    for (int i = 0; i < 3; ++i) {
        ASSERT_TRUE(clip.next(picture));
        EXPECT_EQ(picture.width, 48);
        EXPECT_EQ(picture.height, 60);
        EXPECT_NEAR(clip.time(), i / 10., 1e-9);
    }
    EXPECT_FALSE(clip.next(picture));
    EXPECT_EQ(kept(surveyClip(folder.path(), {})), "kkk");
    writeImage(folder / "p11.png", checks(20, 20, 0));
    EXPECT_NE(messageOf<InputError>([&] {
                  surveyClip(folder.path(), {});
              }).find("p11.png: expected 96×120 pixels, the size of p1.png, found 20×20"),
              std::string::npos);
}

TEST(Clip, HighPicturesAreScaled) {
    Folder folder;
    const fs::path file = film(folder / "a.mp4", moving(1));
    VideoReader video(file, 60);
    EXPECT_EQ(video.width(), 48);
    EXPECT_EQ(video.height(), 60);
    Image picture;
    ASSERT_TRUE(video.next(picture));
    EXPECT_EQ(picture.width, 48);
    EXPECT_EQ(picture.height, 60);
}

TEST(Clip, PixelsBecomeSquare) {
    Folder folder;
    std::vector<uint8_t> bytes = readWholeFile(film(folder / "a.mp4", moving(1)));
    // "pasp": across and down, which the writer leaves at 1:1. Without one there is nothing to
    // change, and the track header's width and height, behind its matrix, say the same.
    const std::string_view name = "tkhd";
    const auto header = std::search(bytes.begin(), bytes.end(), name.begin(), name.end());
    ASSERT_NE(header, bytes.end());
    const auto width = header + 4 + 76;
    ASSERT_EQ(int(width[0]) * 256 + int(width[1]), 96);
    width[0] = 0, width[1] = 192;  // shown twice as wide
    const std::string_view aspect = "pasp";
    const auto box = std::search(bytes.begin(), bytes.end(), aspect.begin(), aspect.end());
    if (box != bytes.end()) box[4 + 3] = 2, box[8 + 3] = 1;
    folder.write("wide.mp4", bytes);
    VideoReader video(folder / "wide.mp4");
    EXPECT_EQ(video.width(), 192);
    EXPECT_EQ(video.height(), 120);
}

TEST(Clip, SelectionsKeepTheSpeed) {
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{0, 4, 8, 12}), 7.5);
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{5, 6, 7}), 30);
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{0, 1, 8}), 7.5);
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{9}), 30);
    Capture capture;
    capture.fps = 24;
    for (int i = 0; i < 9; ++i) {
        capture.frames.push_back({});
        capture.theta.push_back({});
        capture.trans.push_back({});
    }
    EXPECT_EQ(capture.subset(std::vector<size_t>{0, 3, 6}).fps, 8);
}

// ---- masks --------------------------------------------------------------------------------------

// A disc before a background, and a square in which the network saw it.
struct Disc {
    Image picture{160, 120, 3, 40};
    std::vector<uint8_t> truth = std::vector<uint8_t>(160 * 120);
    PersonLandmarks person;

    Disc() {
        for (int y = 0; y < 120; ++y)
            for (int x = 0; x < 160; ++x) {
                if (std::hypot(x + .5 - 70, y + .5 - 60) > 30) continue;
                truth[size_t(y * 160 + x)] = 255;
                std::fill_n(picture.pixel(x, y), 3, uint8_t{200});
            }
        person.roi = {{75, 55}, 110, .3};
        person.mask.resize(size_t(kRoiMaskSide) * kRoiMaskSide);
        for (int v = 0; v < kRoiMaskSide; ++v)
            for (int u = 0; u < kRoiMaskSide; ++u) {
                const Point2 at =
                    person.roi.toPicture({(u + .5) / kRoiMaskSide, (v + .5) / kRoiMaskSide});
                // As blurred as a network's, and two pixels too small.
                person.mask[size_t(v * kRoiMaskSide + u)] =
                    float(2 * (28 - std::hypot(at[0] - 70, at[1] - 60)));
            }
    }
};

double overlap(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
    double both = 0, any = 0;
    for (size_t i = 0; i < a.size(); ++i) both += a[i] && b[i], any += a[i] || b[i];
    return both / any;
}

// As an import cuts the person out of a clip of this one picture.
std::vector<uint8_t> maskOf(const PersonLandmarks& person, const Image& picture) {
    const ClipView view = clipViewOf(person, picture);
    ClipCutter cutter("");
    cutter.learn(view);
    cutter.finish({&view, 1});
    return cutter.cut(0, view, [&](size_t) { return std::make_shared<ClipView>(view); }).mask;
}

TEST(PersonMask, GoesBackToThePicture) {
    const Disc disc;
    const std::vector<float> share = personShare(disc.person, 160, 120);
    EXPECT_NEAR(share[60 * 160 + 70], 1, 1e-3);
    EXPECT_EQ(share[119 * 160 + 159], 0);  // outside of the square
    std::vector<uint8_t> mask(share.size());
    for (size_t i = 0; i < share.size(); ++i) mask[i] = share[i] >= .5f;
    EXPECT_NEAR(overlap(mask, disc.truth), 28. * 28 / 900, .02);
}

TEST(PersonMask, FollowsThePicturesEdges) {
    const Disc disc;
    const std::vector<float> led =
        guidedFilter(disc.picture, personShare(disc.person, 160, 120), 4, 1e-4);
    std::vector<uint8_t> mask(led.size());
    for (size_t i = 0; i < led.size(); ++i) mask[i] = led[i] >= .5f;
    EXPECT_GT(overlap(mask, disc.truth), .95);  // of .87 before
}

TEST(PersonMask, AGuidedFilterKeepsWhatIsFlat) {
    const Image flat(20, 10, 3, 90);
    std::vector<float> share(200);
    for (size_t i = 0; i < share.size(); ++i) share[i] = i % 20 < 10 ? 1.f : 0.f;
    // Without edges it is a mean of means.
    const auto led = guidedFilter(flat, share, 2, 1e-4);
    EXPECT_NEAR(led[5 * 20 + 3], 1, 1e-5);
    EXPECT_NEAR(led[5 * 20 + 9] + led[5 * 20 + 10], 1, 1e-5);
    EXPECT_NEAR(led[5 * 20 + 16], 0, 1e-5);
}

TEST(PersonMask, IslandsAreLeftOut) {
    Disc disc;
    for (int v = 0; v < 12; ++v)
        for (int u = 0; u < 12; ++u) disc.person.mask[size_t((v + 20) * kRoiMaskSide + u + 20)] = 9;
    const auto mask = maskOf(disc.person, disc.picture);
    const Point2 island = disc.person.roi.toPicture({26. / kRoiMaskSide, 26. / kRoiMaskSide});
    EXPECT_EQ(mask[size_t(int(island[1]) * 160 + int(island[0]))], 0);
    EXPECT_GT(overlap(mask, disc.truth), .86);
}

// ---- all of it ----------------------------------------------------------------------------------

ImportSettings settingsFor(const fs::path& source, const fs::path& out, const BodyModel& body) {
    ImportSettings settings;
    settings.request.source = source;
    settings.request.net = PoseNet::Lite;
    settings.request.device = &testDevice();
    settings.request.body = &body;
    settings.out = out;
    settings.overlays = false;
    return settings;
}

BodyPicture noBody(const Camera& camera, const Theta&, const Trans&, const Betas&) {
    return {std::vector<uint8_t>(size_t(camera.width) * size_t(camera.height)), {}};
}

TEST(ImportClip, AFilmBecomesACapture) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Lite, models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    // A drawn figure, which moves to the right before a grey wall.
    const Image scene = readImage(test::sourceFolder() / "tests/data/blazepose/scene_512.png");
    std::vector<Image> pictures;
    for (int i = 0; i < 6; ++i) {
        Image picture(640, 512, 3, 128);
        for (int y = 0; y < 512; ++y)
            std::copy_n(scene.pixel(0, y), scene.rowBytes(), picture.pixel(20 * i, y));
        pictures.push_back(std::move(picture));
    }
    const fs::path file = film(folder / "walk.mp4", pictures, 10);
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    ImportSettings settings = settingsFor(file, folder / "capture", body);
    settings.request.clip.every = 2;
    settings.request.fov = 50;
    settings.request.height = 1.8;
    const ImportResult result = importCapture(settings, noBody);
    EXPECT_EQ(result.layout, "video");
    const Capture capture = readCapture(folder / "capture");
    EXPECT_EQ(capture.name, "walk");
    ASSERT_EQ(capture.size(), 3u);
    EXPECT_NEAR(capture.fps, 5, 1e-3);
    EXPECT_EQ(capture.frames[1].name, "000002");
    EXPECT_TRUE(capture.hasMasks());
    EXPECT_EQ(capture.source.at("camera"), "50 degrees along the longer side, given");
    EXPECT_EQ(capture.source.at("height"), "1.8 m, given");
    EXPECT_NEAR(capture.frames[0].camera.fx, 320 / std::tan(25 * M_PI / 180), 1e-3);
    EXPECT_EQ(capture.betas, betasOfHeight(body, 1.8));
    ASSERT_TRUE(capture.keypoints);
    EXPECT_TRUE(capture.source.at("keypoints").starts_with(kOwnKeypoints));  // a fit asks for it
    // The figure moves by 40 pixels from picture to picture, and so does all that was found.
    const auto nose = [&](size_t f) { return double(capture.keypoints->values[75 * f]); };
    EXPECT_NEAR(nose(2) - nose(0), 80, 8);
    const Npz landmarks = readNpz(folder / "capture/landmarks.npz");
    EXPECT_EQ(landmarks.at("world").shape, (std::vector<int64_t>{3, 33, 3}));
    EXPECT_EQ(landmarks.at("number").toF64(), (std::vector<double>{0, 2, 4}));
    EXPECT_NEAR(landmarks.at("time").toF64()[2], .4, 1e-3);
    const Image mask = readMask(*capture.frames[0].mask);
    const Image wanted =
        readMask(test::sourceFolder() / "tests/data/blazepose/scene_mask_tflite_c0.png");
    ASSERT_EQ(mask.width, 640);
    std::vector<uint8_t> figure;
    for (int y = 0; y < 512; ++y) figure.insert(figure.end(), mask.row(y), mask.row(y) + 512);
    EXPECT_GT(overlap(figure, wanted.data), .9);
}

// A drawn person whose joints are known.
TEST(ImportClip, ASyntheticActorsJointsAreFound) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Heavy, models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    const Capture actor = renderActor(testDevice(), readActor(assetFolder() / "actor", "man"),
                                      actorSession(8, 4, kActorDistance), folder / "actor",
                                      {.size = 512, .samples = 2});
    const Poses truth = readPoses(folder / "actor/truth.npz", false);
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    BlazePose pose(testDevice(), PoseNet::Heavy, models);
    double off = 0, iou = 0;
    for (size_t f = 0; f < actor.size(); ++f) {
        const Image picture = readImage(actor.frames[f].image);
        const std::vector<Detection> people = pose.detect(picture);
        ASSERT_FALSE(people.empty()) << f;
        const PersonLandmarks person = pose.landmarksBothWays(picture, people[0].roi());
        iou += overlap(maskOf(person, picture), readMask(*actor.frames[f].mask).data) /
               double(actor.size());
        const Camera& camera = actor.frames[f].camera;
        const BodyStart start = poser(poser.atJoints(person, camera), camera);
        const auto got = jointPlaces(body, Betas{}, start.theta, start.trans);
        const auto want = jointPlaces(body, Betas{}, truth.theta[f], truth.trans[f]);
        for (size_t j = 0; j < joint::kCount; ++j)
            if (landmarkOfJoint(j))
                off += glm::length((got[j] - got[0]) - (want[j] - want[0])) / 12. /
                       double(actor.size());
    }
    std::cout << "joints " << 1000 * off << " mm, masks' IoU " << iou << "\n";
    EXPECT_LT(off, .08);
    EXPECT_GT(iou, .98);
}

TEST(ImportClip, BrokenFilesAreRefused) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Lite, models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const auto refusal = [&](const fs::path& source) {
        return messageOf<InputError>(
            [&] { importCapture(settingsFor(source, folder / "out", body), noBody); });
    };
    folder.write("empty.mp4", std::string());
    EXPECT_EQ(refusal(folder / "empty.mp4"),
              (folder / "empty.mp4").string() + ": is an empty file");
    folder.write("text.mp4", std::string("not a film"));
    EXPECT_NE(refusal(folder / "text.mp4").find("text.mp4: expected a video (MP4,"),
              std::string::npos);
    const std::vector<uint8_t> whole = readWholeFile(film(folder / "a.mp4", moving(20)));
    folder.write("cut.mp4", std::span(whole).first(whole.size() * 2 / 3));
    EXPECT_NE(refusal(folder / "cut.mp4").find("cut.mp4: "), std::string::npos);
    EXPECT_NE(refusal(folder / "a.mp4").find("a.mp4: expected a person in its"), std::string::npos);
    EXPECT_NE(refusal(folder / "none.mp4").find("expected a video or a folder to import"),
              std::string::npos);
    EXPECT_FALSE(fs::exists(folder / "out"));
}

}  // namespace
}  // namespace doppel
