// Pictures of avatars: where cameras put them, on which background, into which files.
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/rendering.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/background.h"
#include "trainer/commands/render.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/progress.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

constexpr int kSize = 64;
constexpr uint8_t kRed = 204, kGreen = 102, kBlue = 51;  // of the avatar's whole skin

Avatar plainAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.betas = {0.5f, -1, 0.5f};
    avatar.preset = presetByName("ci");
    avatar.textureSize = 16;
    for (int i = 0; i < 16 * 16; ++i)
        for (uint8_t byte : {kRed, kGreen, kBlue})
            avatar.texture.push_back(static_cast<float>(byte) / 255.0f);
    return avatar;
}

Camera smallCamera() { return {90, 90, kSize / 2.0, kSize / 2.0, kSize, kSize}; }

// Standing 3.5 m before the camera, turned a little more in each frame.
Motion standing(size_t frames) {
    Motion motion;
    motion.name = "standing";
    motion.fps = 12;
    for (size_t f = 0; f < frames; ++f) {
        Theta theta{};
        auto root = uprightOrientation(0.4f * static_cast<float>(f));
        std::ranges::copy(root, theta.begin());
        theta[3 * 16 + 2] = -0.6f;
        motion.theta.push_back(theta);
        motion.trans.push_back({0.05f * static_cast<float>(f), 0.1f, 3.5f});
        motion.cameras.push_back(smallCamera());
    }
    return motion;
}

struct Extent {
    int left = 1 << 20, top = 1 << 20, right = -1, bottom = -1;  // inclusive
    int count = 0;
};

Extent extentOf(const std::vector<uint8_t>& mask, int width) {
    Extent extent;
    for (size_t i = 0; i < mask.size(); ++i) {
        if (mask[i] < 128) continue;
        int x = static_cast<int>(i) % width, y = static_cast<int>(i) / width;
        extent.left = std::min(extent.left, x);
        extent.right = std::max(extent.right, x);
        extent.top = std::min(extent.top, y);
        extent.bottom = std::max(extent.bottom, y);
        ++extent.count;
    }
    return extent;
}

// Where a picture is not the background's colour.
std::vector<uint8_t> maskOf(const Image& image, std::array<uint8_t, 3> background) {
    std::vector<uint8_t> mask;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            mask.push_back(std::equal(background.begin(), background.end(), image.pixel(x, y))
                               ? uint8_t{0}
                               : uint8_t{255});
    return mask;
}

void expectColour(const Image& image, int x, int y, std::array<int, 3> colour, int tolerance = 0) {
    for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(int{image.pixel(x, y)[c]}, colour[static_cast<size_t>(c)], tolerance)
            << "pixel " << x << " " << y << " channel " << c;
}

// The avatar, a motion of two frames as a poses.npz in a world, and as a capture with pictures.
struct Scene {
    Folder folder;
    Avatar avatar = plainAvatar();
    Motion motion = standing(2);

    Scene() {
        writeAvatar(folder / "avatar", avatar);
        writeNpz(folder / "poses.npz", posesArrays(motion.theta, motion.trans, motion.betas),
                 false);
    }

    RenderOptions options(const fs::path& out) const {
        RenderOptions options;
        options.avatar = folder / "avatar";
        options.motion = folder / "poses.npz";
        options.out = folder.path() / out;
        return options;
    }

    // [3,3] and [4,4], of all frames.
    void writeCameras(const fs::path& path, const Camera& camera,
                      const std::vector<double>& extrinsic) const {
        Npz npz;
        npz.set("intrinsic",
                Array::f64({3, 3}, std::vector<double>{camera.fx, 0, camera.cx, 0, camera.fy,
                                                       camera.cy, 0, 0, 1}));
        npz.set("height", Array::scalarI64(camera.height));
        npz.set("width", Array::scalarI64(camera.width));
        npz.set("extrinsic", Array::f64({4, 4}, extrinsic));
        writeNpz(path, npz, false);
    }
};

const std::vector<double> kIdentity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

// ---- cameras ------------------------------------------------------------------------------------

TEST(CameraFile, PutsKnownPointsOnKnownPixels) {
    Scene scene;
    // Looking along -x from (5, -0.2, 3.4), y down: camera x is world z, camera z is world -x.
    Camera camera{123, 117, 70.5, 41.25, 160, 100};
    std::vector<double> extrinsic{0, 0, 1, -3.4, 0, 1, 0, 0.2, -1, 0, 0, 5, 0, 0, 0, 1};
    scene.writeCameras(scene.folder / "side.npz", camera, extrinsic);
    Motion seen = throughCameras(scene.motion, scene.folder / "side.npz");
    ASSERT_EQ(seen.cameras.size(), 2u);
    EXPECT_EQ(seen.cameras[1], camera);

    BodyPoser poser(testDevice(), scene.avatar.body);
    for (size_t f = 0; f < 2; ++f) {
        PosedMesh world =
            poser.pose(scene.motion.theta[f], scene.motion.trans[f], scene.avatar.betas);
        PosedMesh moved = poser.pose(seen.theta[f], seen.trans[f], scene.avatar.betas);
        for (size_t j = 0; j < 24; ++j) {
            const auto& p = world.joints[j];
            // By hand: u = 123 x_cam / z_cam + 70.5.
            double x = p[2] - 3.4, y = p[1] + 0.2, z = 5 - p[0];
            std::array<double, 2> pixel = camera.project(moved.joints[j]);
            EXPECT_NEAR(pixel[0], 123 * x / z + 70.5, 2e-3) << "frame " << f << " joint " << j;
            EXPECT_NEAR(pixel[1], 117 * y / z + 41.25, 2e-3) << "frame " << f << " joint " << j;
        }
    }
}

TEST(CameraFile, SeesTheMotionAsItWasSmoothed) {
    Scene scene;
    Motion motion = standing(3);
    motion.trans[1][0] += .4f;  // which smoothing takes back
    writeNpz(scene.folder / "poses.npz", posesArrays(motion.theta, motion.trans, motion.betas),
             false);
    scene.writeCameras(scene.folder / "plain.npz", smallCamera(), kIdentity);
    RenderOptions options = scene.options("rough");
    options.camera = (scene.folder / "plain.npz").string();
    options.background = "#102030";
    runRender(options);
    options.out = scene.folder / "smooth";
    options.smooth = 5;
    runRender(options);
    EXPECT_NE(readImage(scene.folder / "smooth" / "0001.png").data,
              readImage(scene.folder / "rough" / "0001.png").data);
}

TEST(CameraFile, MovesThePictureAsItsNumbersSay) {
    // The principal point moved by whole pixels, and the lens twice as long about it.
    Scene scene;
    Camera camera = smallCamera(), shifted = camera;
    shifted.cx += 7, shifted.cy -= 5;
    Camera near = camera;
    near.fx *= 2, near.fy *= 2;
    near.width = near.height = 2 * kSize;
    near.cx = near.cy = kSize;
    scene.writeCameras(scene.folder / "plain.npz", camera, kIdentity);
    scene.writeCameras(scene.folder / "shifted.npz", shifted, kIdentity);
    scene.writeCameras(scene.folder / "near.npz", near, kIdentity);
    for (const char* name : {"plain", "shifted", "near"}) {
        RenderOptions options = scene.options(name);
        options.camera = (scene.folder / (std::string(name) + ".npz")).string();
        options.background = "#102030";
        runRender(options);
    }
    RenderOptions half = scene.options("half");
    half.camera = (scene.folder / "near.npz").string();
    half.background = "#102030";
    half.size = kSize;
    runRender(half);

    for (const char* name : {"0000.png", "0001.png"}) {
        Image plain = readImage(scene.folder / "plain" / name);
        Image moved = readImage(scene.folder / "shifted" / name);
        ASSERT_EQ(plain.width, kSize);
        for (int y = 5; y < kSize; ++y)
            for (int x = 0; x < kSize - 7; ++x)
                for (int c = 0; c < 3; ++c)
                    ASSERT_EQ(plain.pixel(x, y)[c], moved.pixel(x + 7, y - 5)[c]) << x << " " << y;
        Image large = readImage(scene.folder / "near" / name);
        ASSERT_EQ(large.width, 2 * kSize);
        Extent small = extentOf(maskOf(plain, {0x10, 0x20, 0x30}), kSize);
        Extent big = extentOf(maskOf(large, {0x10, 0x20, 0x30}), 2 * kSize);
        EXPECT_GT(small.count, 300);
        EXPECT_NEAR(big.top / 2.0, small.top, 1);
        EXPECT_NEAR(big.bottom / 2.0, small.bottom, 1);
        EXPECT_NEAR(big.left / 2.0, small.left, 1);
        // --size makes the same view smaller: the plain camera again.
        Image again = readImage(scene.folder / "half" / name);
        EXPECT_EQ(again.data, plain.data);
    }
}

TEST(CameraFile, MayHaveACameraForEachFrameOfTheMotion) {
    Scene scene;
    Npz npz;
    npz.set("intrinsic",
            Array::f64({2, 3, 3}, std::vector<double>{90, 0, 20, 0, 90, 32, 0, 0, 1,  //
                                                      90, 0, 44, 0, 90, 32, 0, 0, 1}));
    npz.set("height", Array::scalarI64(kSize));
    npz.set("width", Array::scalarI64(kSize));
    writeNpz(scene.folder / "two.npz", npz, false);
    RenderOptions options = scene.options("both");
    options.camera = (scene.folder / "two.npz").string();
    options.background = "#000000";
    runRender(options);
    Image first = readImage(options.out / "0000.png"), second = readImage(options.out / "0001.png");
    EXPECT_LT(extentOf(maskOf(first, {0, 0, 0}), kSize).left, 12);
    EXPECT_GT(extentOf(maskOf(second, {0, 0, 0}), kSize).right, 52);
    options.frames = "1";
    options.out = scene.folder / "second";
    runRender(options);
    EXPECT_EQ(readImage(options.out / "0000.png").data, second.data);
}

TEST(CameraFile, IsRefusedWithOneSentence) {
    Scene scene;
    RenderOptions options = scene.options("out");
    options.background = "#000000";
    auto refuse = [&](const std::string& words) {
        expectInputError([&] { runRender(options); }, words);
        EXPECT_FALSE(fs::exists(options.out));
    };
    options.camera = (scene.folder / "none.npz").string();
    refuse("none.npz");
    options.camera = (scene.folder / "poses.npz").string();
    refuse("poses.npz: expected an array 'width'");
    options.camera = "capture";  // a poses.npz has none
    refuse("it has poses but no cameras; use --camera turntable or a cameras.npz");
}

TEST(OwnCameras, AreTheMotions) {
    Motion motion = standing(3);
    motion.cameras[2].cx = 9;
    std::vector<Shot> shots = throughOwnCameras(motion);
    ASSERT_EQ(shots.size(), 3u);
    EXPECT_EQ(shots[2].camera, motion.cameras[2]);
    EXPECT_EQ(shots[1].theta, motion.theta[1]);
    EXPECT_EQ(shots[1].trans, motion.trans[1]);
}

// ---- the turntable ------------------------------------------------------------------------------

TEST(Turntable, StandsInTheMiddleUprightFacingTheCamera) {
    Avatar avatar = plainAvatar();
    Shot shot = restShot(testDevice(), avatar, 96);
    EXPECT_EQ(shot.camera.width, 96);
    EXPECT_EQ(shot.camera.height, 96);
    AvatarRenderer renderer(testDevice(), avatar);
    Extent extent = extentOf(renderer.mask(shot.theta, shot.trans, shot.camera), 96);
    EXPECT_GT(extent.bottom - extent.top + 1, 80);  // of 96
    EXPECT_NEAR(extent.top, 95 - extent.bottom, 2);
    EXPECT_NEAR(extent.left, 95 - extent.right, 2);
    EXPECT_GT(extent.top, 0);
    BodyPoser poser(testDevice(), avatar.body);
    std::vector<std::array<double, 3>> joints =
        poser.pose(shot.theta, shot.trans, avatar.betas).joints;
    EXPECT_LT(joints[15][1], joints[0][1]);   // the head above the pelvis: y points down
    EXPECT_LT(joints[10][2], joints[7][2]);   // the foot nearer to the camera than the ankle
    EXPECT_GT(joints[16][0], joints[17][0]);  // the left shoulder on the picture's right
}

TEST(Turntable, CameraGoesRoundTheBody) {
    Avatar avatar = plainAvatar();
    Shot rest = restShot(testDevice(), avatar, 96);
    BodyPoser poser(testDevice(), avatar.body);
    auto joints = [&](const Shot& shot) {
        return poser.pose(shot.theta, shot.trans, avatar.betas).joints;
    };
    const auto before = joints(rest);
    for (double turns : {0.25, 0.5, 0.875, 1.0}) {
        Shot shot = turned(rest, turns);
        EXPECT_EQ(shot.camera, rest.camera);
        const auto after = joints(shot);
        double c = std::cos(2 * std::acos(-1.0) * turns), s = std::sin(2 * std::acos(-1.0) * turns);
        for (size_t j = 0; j < 24; ++j) {
            std::array<double, 3> d;
            for (size_t k = 0; k < 3; ++k) d[k] = before[j][k] - before[0][k];
            EXPECT_NEAR(after[j][0], before[0][0] + c * d[0] + s * d[2], 1e-5) << turns << " " << j;
            EXPECT_NEAR(after[j][1], before[0][1] + d[1], 1e-5) << turns << " " << j;
            EXPECT_NEAR(after[j][2], before[0][2] - s * d[0] + c * d[2], 1e-5) << turns << " " << j;
        }
    }
}

TEST(Turntable, TurnsOnceWhileTheMotionGoesOn) {
    Scene scene;
    scene.motion = standing(4);
    for (Theta& theta : scene.motion.theta) theta = scene.motion.theta[0];
    scene.motion.theta[2][3 * 17 + 2] = 0.9f;  // an arm moves in one frame
    writeNpz(scene.folder / "poses.npz",
             posesArrays(scene.motion.theta, scene.motion.trans, scene.motion.betas), false);
    RenderOptions options = scene.options("turn");
    options.camera = "turntable";
    options.retarget.on = false;  // the poses as they are, though the avatar is another body
    options.background = "#000000";
    options.size = 48;
    runRender(options);
    // The pictures, and the list of them.
    EXPECT_EQ(std::distance(fs::directory_iterator(options.out), {}), 4 + 1);

    Shot rest = restShot(testDevice(), scene.avatar, 48);
    AvatarRenderer renderer(testDevice(), scene.avatar);
    for (size_t f = 0; f < 4; ++f) {
        Shot shot = rest;
        shot.theta = scene.motion.theta[f];
        shot = turned(shot, 0.25 * static_cast<double>(f));
        Drawing expected = renderer.draw(shot.theta, shot.trans, shot.camera, 2);
        Image image = readImage(options.out / fmt::format("{:04}.png", f));
        ASSERT_EQ(image.width, 48);
        ASSERT_EQ(image.height, 48);
        for (size_t i = 0; i < image.data.size(); ++i)
            ASSERT_NEAR(image.data[i], 255 * static_cast<double>(expected.rgb[i]), 1.01)
                << "frame " << f;
    }
}

// Two pictures under way, of one size and of two, are those that are drawn one by one.
TEST(AvatarRenderer, DrawsTwoPicturesAtATime) {
    Scene scene;
    AvatarRenderer renderer(testDevice(), scene.avatar);
    Shot first = restShot(testDevice(), scene.avatar, 48), second = turned(first, 0.3);
    Shot larger = turned(restShot(testDevice(), scene.avatar, 64), 0.6);
    auto draw = [&](const Shot& s) { return renderer.draw(s.theta, s.trans, s.camera, 2); };
    auto submit = [&](const Shot& s) { renderer.submit(s.theta, s.trans, s.camera, 2); };
    const std::vector<Shot> shots{first, second, larger, first, larger, larger};
    std::vector<Drawing> expected;
    for (const Shot& shot : shots) expected.push_back(draw(shot));
    EXPECT_NE(expected[0].rgb, expected[1].rgb);
    submit(shots[0]);
    for (size_t i = 0; i < shots.size(); ++i) {
        if (i + 1 < shots.size()) submit(shots[i + 1]);
        Drawing drawing = renderer.take();
        EXPECT_EQ(drawing.width, shots[i].camera.width) << i;
        EXPECT_EQ(drawing.rgb, expected[i].rgb) << i;
        EXPECT_EQ(drawing.mask, expected[i].mask) << i;
    }
}

// ---- backgrounds and files ----------------------------------------------------------------------

TEST(RenderShots, DrawsOverTheBackgroundIntoAFolder) {
    Scene scene;
    std::vector<Shot> shots = throughOwnCameras(scene.motion);
    auto backdrop = [&](size_t i) {
        return plainBackground(i == 0 ? "#0a141e" : "#28323c", shots[i].camera);
    };
    fs::path out = scene.folder / "pictures";
    renderShots(testDevice(), scene.avatar, shots, {backdrop}, out, 10, "test");
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(out)) names.push_back(entry.path().filename());
    std::ranges::sort(names);
    EXPECT_EQ(names, (std::vector<std::string>{".doppel-files", "0000.png", "0001.png"}));
    names.erase(names.begin());

    BodyPoser poser(testDevice(), scene.avatar.body);
    for (size_t f = 0; f < 2; ++f) {
        Image image = readImage(out / names[f]);
        expectColour(image, 0, 0,
                     f == 0 ? std::array<int, 3>{10, 20, 30} : std::array<int, 3>{40, 50, 60});
        auto chest = shots[f].camera.project(
            poser.pose(shots[f].theta, shots[f].trans, scene.avatar.betas).joints[9]);
        expectColour(image, static_cast<int>(chest[0]), static_cast<int>(chest[1]),
                     {kRed, kGreen, kBlue}, 1);
    }
    // Again in the same place; but never over somebody's files.
    renderShots(testDevice(), scene.avatar, {shots[0]}, {backdrop}, out, 10, "test");
    EXPECT_FALSE(fs::exists(out / "0001.png"));
    fs::create_directory(scene.folder / "letters");
    scene.folder.write("letters/will.txt", std::string("all to the cat"));
    expectInputError(
        [&] {
            renderShots(testDevice(), scene.avatar, shots, {backdrop}, scene.folder / "letters", 10,
                        "test");
        },
        "letters: expected an empty folder or one that Doppel wrote as render, which would be "
        "replaced; found will.txt");
}

// Stripes narrower than pixels, which a camera passes by a ninth of a pixel each.
TEST(RenderShots, MoreSamplesShimmerLess) {
    Scene scene;
    scene.avatar.textureSize = 128;
    scene.avatar.texture.resize(3 * 128 * 128);
    for (size_t i = 0; i < scene.avatar.texture.size(); ++i)
        scene.avatar.texture[i] = i / 6 % 2 == 0 ? .1f : .9f;
    const Shot still = throughOwnCameras(scene.motion)[0];
    std::vector<Shot> shots;
    for (int i = 0; i < 9; ++i) {
        shots.push_back(still);
        shots.back().camera.cx += i / 9.;
    }
    const auto shimmer = [&](int samples) {
        Layers layers{
            .background = [&](size_t i) { return plainBackground("#808080", shots[i].camera); },
            .samples = samples};
        return renderShots(testDevice(), scene.avatar, shots, layers, scene.folder / "shimmer", 10,
                           "test");
    };
    const double one = shimmer(1), two = shimmer(2), four = shimmer(4);
    EXPECT_LT(two, .8 * one);
    EXPECT_LT(four, .8 * two);
    EXPECT_EQ(RenderOptions().samples, Layers().samples);
}

TEST(RenderShots, MakesAFilmOfTheSamePictures) {
    Scene scene;
    scene.motion = standing(5);
    std::vector<Shot> shots = throughOwnCameras(scene.motion);
    auto grey = [&](size_t i) { return plainBackground("#808080", shots[i].camera); };
    fs::path film = scene.folder / "film.mp4", folder = scene.folder / "pictures";
    renderShots(testDevice(), scene.avatar, shots, {grey}, film, 12.5, "test");
    renderShots(testDevice(), scene.avatar, shots, {grey}, folder, 12.5, "test");
    VideoReader reader(film);
    EXPECT_EQ(reader.width(), kSize);
    EXPECT_EQ(reader.height(), kSize);
    EXPECT_NEAR(reader.framesPerSecond(), 12.5, 1e-3);
    Image frame;
    size_t count = 0;
    for (; reader.next(frame); ++count) {
        ASSERT_LT(count, shots.size());
        Image picture = readImage(folder / fmt::format("{:04}.png", count));
        double sum = 0;
        for (size_t i = 0; i < picture.data.size(); ++i)
            sum += std::abs(int{frame.data[i]} - int{picture.data[i]});
        EXPECT_LT(sum / static_cast<double>(picture.data.size()), 4) << "frame " << count;
    }
    EXPECT_EQ(count, shots.size());
}

TEST(RenderShots, LeavesNothingWhenStoppedOrRefused) {
    Scene scene;
    std::vector<Shot> shots = throughOwnCameras(scene.motion);
    auto stop = [&](size_t i) {
        if (i == 0) raise(SIGINT);
        return plainBackground("#808080", shots[i].camera);
    };
    std::vector<std::string> before = scene.folder.names();
    for (const char* name : {"film.mp4", "pictures"}) {
        catchInterrupts();
        EXPECT_THROW(
            renderShots(testDevice(), scene.avatar, shots, {stop}, scene.folder / name, 10, "test"),
            Interrupted);
        EXPECT_EQ(scene.folder.names(), before) << name;
    }
    catchInterrupts();
    signal(SIGINT, SIG_DFL);
    auto grey = [&](size_t i) { return plainBackground("#808080", shots[i].camera); };
    shots[1].camera.width = 2 * kSize;
    expectInputError(
        [&] {
            renderShots(testDevice(), scene.avatar, shots, {grey}, scene.folder / "film.mp4", 10,
                        "test");
        },
        "film.mp4: a film needs frames of one size; give --size or a folder");
    EXPECT_EQ(scene.folder.names(), before);
    // Pictures may differ in size.
    renderShots(testDevice(), scene.avatar, shots, {grey}, scene.folder / "pictures", 10, "test");
    EXPECT_EQ(readImage(scene.folder / "pictures" / "0001.png").width, 2 * kSize);
}

TEST(Render, PutsTheAvatarWhereThePersonWas) {
    // A capture whose frames show a striped wall and a person (here in white) where the avatar
    // stands in the first frame and somewhere else in the second.
    Scene scene;
    AvatarRenderer renderer(testDevice(), scene.avatar);
    auto stripes = [](int x, int y, size_t f) {
        return static_cast<uint8_t>(20 + (x / 4 % 2) * 60 + y / 2 + 5 * static_cast<int>(f));
    };
    Capture capture;
    capture.name = "striped";
    capture.fps = 12;
    capture.betas = scene.avatar.betas;
    CaptureWriter writer(scene.folder / "capture");
    std::vector<std::vector<uint8_t>> masks;
    for (size_t f = 0; f < 2; ++f) {
        Trans trans = scene.motion.trans[f];
        if (f == 1) trans[0] += 0.8f;
        masks.push_back(renderer.mask(scene.motion.theta[f], trans, smallCamera()));
        std::vector<uint8_t> rgb;
        for (size_t i = 0; i < masks[f].size(); ++i)
            rgb.insert(rgb.end(), 3,
                       masks[f][i]
                           ? uint8_t{255}
                           : stripes(static_cast<int>(i) % kSize, static_cast<int>(i) / kSize, f));
        std::string name = fmt::format("f{}", f);
        writer.addImage(name, kSize, kSize, rgb);
        writer.addMask(name, kSize, kSize, masks[f]);
        capture.frames.push_back({name, {}, {}, smallCamera()});
        capture.theta.push_back(scene.motion.theta[f]);
        capture.trans.push_back(scene.motion.trans[f]);
    }
    capture = writer.commit(capture);

    RenderOptions options = scene.options("out");
    options.motion = scene.folder / "capture";
    runRender(options);  // --camera capture --background capture
    FrameCache frames(capture);
    BackgroundPlate plate(capture, frames);
    for (size_t f = 0; f < 2; ++f) {
        Image image = readImage(options.out / fmt::format("{:04}.png", f));
        Drawing drawn = renderer.draw(capture.theta[f], capture.trans[f], smallCamera(), 2);
        std::vector<uint8_t> person = dilateMask(masks[f], kSize, kSize, 3);
        std::vector<float> behind = plate.behind(*frames.load(f));
        int own = 0, skin = 0, white = 0;
        for (int y = 0; y < kSize; ++y)
            for (int x = 0; x < kSize; ++x) {
                auto i = static_cast<size_t>(y * kSize + x);
                int value = image.pixel(x, y)[0];
                if (value == 255) ++white;
                if (drawn.mask[i] == 255) {
                    expectColour(image, x, y, {kRed, kGreen, kBlue}, 1);
                    ++skin;
                } else if (drawn.mask[i] == 0 && !person[i]) {
                    ASSERT_EQ(value, stripes(x, y, f)) << "the frame's own pixel";
                    ++own;
                } else if (drawn.mask[i] == 0) {
                    ASSERT_EQ(value, std::lround(255 * behind[3 * i])) << "the plate's";
                }
            }
        EXPECT_GT(own, 2000);
        EXPECT_GT(skin, 200);
        EXPECT_EQ(white, 0) << "nothing of the person is left";
    }
    // Frames of the motion are chosen with --frames; other cameras have no pictures behind them.
    options.frames = "1:2";
    options.out = scene.folder / "second";
    runRender(options);
    EXPECT_EQ(readImage(options.out / "0000.png").data,
              readImage(scene.folder / "out" / "0001.png").data);
    EXPECT_FALSE(fs::exists(options.out / "0001.png"));
    // A motion needs no masks: nothing tells what is behind the person, and it is grey.
    fs::copy(scene.folder / "capture", scene.folder / "unmasked", fs::copy_options::recursive);
    fs::remove_all(scene.folder / "unmasked" / "masks");
    RenderOptions unmasked = options;
    unmasked.motion = scene.folder / "unmasked";
    unmasked.out = scene.folder / "unmasked-out";
    runRender(unmasked);
    expectColour(readImage(unmasked.out / "0000.png"), 0, 0, {127, 127, 127});
    // Films of other kinds are not written.
    unmasked.out = scene.folder / "film.avi";
    expectInputError(
        [&] { runRender(unmasked); },
        "film.avi: expected a film that ends with .mp4, .webm, .mov, .webp or .gif, or a folder ");
    EXPECT_FALSE(fs::exists(unmasked.out));

    options.camera = "turntable";
    options.size = 40;
    options.out = scene.folder / "grey";
    runRender(options);
    expectColour(readImage(options.out / "0000.png"), 0, 0, {127, 127, 127});
}

TEST(PlainBackground, IsItsColour) {
    Camera camera = smallCamera();
    std::vector<float> picture = plainBackground("#ff8000", camera);
    ASSERT_EQ(picture.size(), size_t{3} * kSize * kSize);
    EXPECT_EQ(picture[0], 1);
    EXPECT_NEAR(picture[1], 128 / 255.0, 1e-7);
    EXPECT_EQ(picture.back(), 0);
    for (const char* wrong : {"#12345", "#1234567", "#12345g", "#-12345", "x123456"})
        expectInputError([&] { plainBackground(wrong, camera); }, "--background: expected");
}

}  // namespace
}  // namespace doppel
