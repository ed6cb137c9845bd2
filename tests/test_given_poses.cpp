// Which of a file's poses are a capture's, and what is done where they are not: people, gaps,
// names, scales, other clips.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/io/image.h"
#include "tests/estimate_scene.h"
#include "tests/files.h"
#include "trainer/import/import.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using namespace test;

TEST(GivenPoses, TheMaskTellsWhoItIs) {
    Folder folder;
    const Truth truth;
    // Followed by two tracks one after the other, with somebody else beside all the time.
    write(folder, "vibe_output.pkl",
          py::dict({{py::integer(7), vibePerson(truth, {{0, 1, 2, 3, 4, 5}, -90})},
                    {py::integer(8), vibePerson(truth, {{0, 1, 2}})},
                    {py::integer(9), vibePerson(truth, {{3, 4, 5}})}}));
    Scene scene(folder / "capture");
    scene.capture.source["heads"] = "by the ears";
    EXPECT_EQ(scene.take(folder / "vibe_output.pkl").told,
              "VIBE, person 8 and 9 of 3 people, boxes as they are");
    expectTruth(scene, truth);
    EXPECT_FALSE(scene.capture.source.contains("heads")) << "theirs are the given poses'";
}

TEST(GivenPoses, GapsAreFilledOrLeftOut) {
    Folder folder;
    const Truth truth;
    write(folder, "vibe_output.pkl",
          py::dict({{py::integer(1), vibePerson(truth, {{0, 1, 3, 4}})}}));
    Scene scene(folder / "capture");
    const GivenPoses given = scene.take(folder / "vibe_output.pkl");
    EXPECT_EQ(given.filled, "1 between their neighbours, frames left out, which have none: 1");
    ASSERT_EQ(scene.capture.size(), 5u);
    EXPECT_EQ(scene.capture.frames[4].name, "000004");
    EXPECT_LT(degreesApart(scene.capture.theta[2], truth.theta[2]), 15);
    EXPECT_NEAR(scene.capture.trans[2][0], truth.trans[2][0], .03);
    // What belongs to frames that are left out is gone from where the capture is made.
    {
        Scene made(folder / "made");
        const fs::path place = folder / "made";
        std::vector<float> presence{0, 1, 2, 3, 4, 5};
        Npz landmarks;
        landmarks.set("presence", Array::f32({6}, presence));
        writeNpz(place / "landmarks.npz", landmarks, false);
        folder.write(
            "made/quality.json",
            std::string(
                "{\"frames\": 6, \"left_out\": [], \"per_frame\": {"
                "\"000004\": {\"presence\": 1}, \"000005\": {\"picture\": \"last.jpg\"}}}"));
        made.take(folder / "vibe_output.pkl", "clip.mp4", place);
        notePoseOverlaps(place, made.capture, std::vector<double>{.5, .6, .7, .8, .9});
        const auto quality = nlohmann::json::parse(bytesOf(place / "quality.json"));
        EXPECT_EQ(quality["frames"], 5);
        EXPECT_EQ(quality["left_out"][0]["frame"], 5);
        EXPECT_EQ(quality["left_out"][0]["picture"], "last.jpg");
        EXPECT_FALSE(quality["per_frame"].contains("000005"));
        EXPECT_EQ(quality["per_frame"]["000004"]["presence"], 1);
        EXPECT_EQ(quality["per_frame"]["000004"]["pose_iou"], .9);
        EXPECT_NEAR(quality["pose_iou"].get<double>(), .7, 1e-9);
        EXPECT_TRUE(fs::exists(place / "images/000004.png"));
        EXPECT_FALSE(fs::exists(place / "images/000005.png"));
        EXPECT_FALSE(fs::exists(place / "masks/000005.png"));
        EXPECT_EQ(readNpz(place / "landmarks.npz").at("presence").toF32(),
                  (std::vector<float>{0, 1, 2, 3, 4}));
    }
    // A clip of which each second picture was taken.
    Scene half(folder / "half", truth, 2);
    EXPECT_EQ(half.take(folder / "vibe_output.pkl").filled, "1 between their neighbours");
    EXPECT_EQ(half.capture.size(), 3u);
    EXPECT_NEAR(half.capture.trans[2][0], truth.trans[4][0], .03);
}

// A folder of pictures whose names the poses know, and pickles of one picture each.
TEST(GivenPoses, NamesOfPictures) {
    Folder folder;
    const Truth truth;
    fs::create_directories(folder / "poses");
    fs::create_directories(folder / "clip");
    for (size_t f = 0; f < kFrames; ++f) {
        const std::string name = fmt::format("shot{}", 10 * f);
        writeImage(folder / ("clip/" + name + ".png"), Image(kWidth, kHeight, 3));
        folder.write(
            "poses/" + name + ".jpg_body.pkl",
            py::pickle(py::dict({{py::text("pose"), py::array({72}, numbers(truth.theta[f]))},
                                 {py::text("trans"), py::array({3}, numbers(truth.trans[f]))},
                                 {py::text("betas"), py::array({10}, std::vector<double>(10, 2))},
                                 {py::text("f"), py::real(truth.camera.fx)}})));
    }
    fs::remove(folder / "poses/shot20.jpg_body.pkl");
    Scene scene(folder / "capture");
    const GivenPoses given = scene.take(folder / "poses", folder / "clip");
    EXPECT_EQ(given.told, "SPIN");
    EXPECT_EQ(given.filled, "1 between their neighbours");
    for (const size_t f : {0, 1, 3, 4, 5})
        EXPECT_LT(degreesApart(scene.capture.theta[f], truth.theta[f]), .1) << f;
}

// Pictures that were scaled on the way in: boxes are in those of the file.
TEST(GivenPoses, BoxesAreInTheSourcesPixels) {
    Folder folder;
    Truth large;
    const Truth truth;
    fs::create_directories(folder / "clip");
    for (size_t f = 0; f < kFrames; ++f)
        writeImage(folder / ("clip/" + stem(f) + ".png"), Image(2 * kWidth, 2 * kHeight, 3));
    large.camera = cameraOfAngle(2 * kWidth, 2 * kHeight, kGuessedAngle);
    write(folder, "vibe_output.pkl", py::dict({{py::integer(1), vibePerson(large, kTruth)}}));
    Scene scene(folder / "capture");
    scene.take(folder / "vibe_output.pkl", folder / "clip");
    expectTruth(scene, truth);
    EXPECT_EQ(scene.capture.frames[0].camera.width, kWidth);
}

TEST(GivenPoses, RefusesWhatDoesNotFit) {
    Folder folder;
    Truth truth;
    // Upside down in the wrong place: poses of another clip.
    Truth other;
    for (size_t f = 0; f < kFrames; ++f) other.trans[f] = {-.1f, -1.2f, 7};
    write(folder, "other.pkl", py::dict({{py::integer(1), vibePerson(other, kTruth)}}));
    Scene scene(folder / "capture");
    const std::string message = messageOf<InputError>([&] { scene.take(folder / "other.pkl"); });
    EXPECT_NE(
        message.find("other.pkl: expected poses of the person in the masks, found an overlap"),
        std::string::npos)
        << message;
    // Of pictures that the capture does not have.
    const auto late = [&](int64_t number) {
        const auto one = vibePerson(truth, {{0}});
        std::string bytes = one;
        const std::string id = py::list({py::integer(0)}), then = py::list({py::integer(number)});
        bytes.replace(bytes.rfind(id), id.size(), then);
        return py::dict({{py::integer(1), bytes}});
    };
    write(folder, "late.pkl", late(900));
    const auto apart = py::dict({{py::integer(1), vibePerson(truth, {{0, 1}})}});
    std::string bytes = apart;
    const std::string ids = py::list({py::integer(0), py::integer(1)});
    bytes.replace(bytes.rfind(ids), ids.size(), py::list({py::integer(0), py::integer(99999999)}));
    write(folder, "apart.pkl", bytes);
    EXPECT_NE(messageOf<InputError>([&] {
                  readMotion(folder / "apart.pkl");
              }).find("apart.pkl: expected poses of at most 1000000 pictures, found more"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] { scene.take(folder / "late.pkl"); })
                  .find("late.pkl: expected poses of the capture's frames, found poses of other "
                        "pictures: 6 frames from 0 on, poses from picture 900 on"),
              std::string::npos);
}

// Real outputs of SPIN, where they are: what the layout's importer makes of the same files.
TEST(GivenPoses, RealPosesOfSpin) {
    const fs::path views = test::sourceFolder() / "../shared/data/retargeting/8-views";
    if (!fs::exists(views)) GTEST_SKIP() << "no dataset in ../shared/data";
    Folder folder;
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    BodyPoser poser(testDevice(), body);
    MeshDrawer drawer(testDevice(), body);
    const DrawBody draw = [&](const Camera& camera, const Theta& theta, const Trans& trans,
                              const Betas& betas) {
        return BodyPicture{drawer.mask(poser.pose(theta, trans, betas).verts, camera), {}};
    };
    ImportSettings settings;
    settings.request.source = views;
    settings.overlays = false;
    settings.out = folder / "plain";
    const ImportResult plain = importCapture(settings, draw);
    settings.out = folder / "given";
    settings.request.poses = views / "smpl_pose";
    const ImportResult given = importCapture(settings, draw);
    EXPECT_EQ(given.poses, "SPIN");
    ASSERT_EQ(given.capture.size(), plain.capture.size());
    ASSERT_EQ(given.iou.size(), plain.capture.size());
    for (size_t f = 0; f < given.capture.size(); ++f) {
        EXPECT_LT(degreesApart(given.capture.theta[f], plain.capture.theta[f]), .01);
        EXPECT_EQ(given.capture.frames[f].camera, plain.capture.frames[f].camera);
    }
    EXPECT_GE(given.meanIou, plain.meanIou);
    EXPECT_GT(given.meanIou, .69);
}

}  // namespace
}  // namespace doppel
