// The light of a capture: an actor who turns under a lamp, and what training makes of her with and
// without a light of its own; and how avatars keep it. The exposure of each frame, likewise.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <regex>
#include <sstream>

#include "engine/io/image.h"
#include "nn/ops/fit.h"
#include "nn/ops/optim.h"
#include "nn/steps/light.h"
#include "nn/steps/surface_step.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/commands/cli.h"
#include "trainer/data/frame_cache.h"
#include "trainer/data/frame_selection.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/surface.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

// Sixteen frames of a turn, in the actor's true poses.
Capture recorded(const fs::path& folder, const std::vector<float>& light) {
    SyntheticOptions options;
    options.size = 128;
    options.samples = 2;
    options.poseNoiseDegrees = options.transNoiseMetres = 0;
    options.light = light;
    return renderActor(testDevice(), readActor(assetFolder() / "actor", "woman"),
                       actorSession(16, 0, kActorDistance), folder, options);
}

// Under the lamp.
const Capture& turn() {
    static const test::Folder folder;
    static const Capture capture = recorded(folder.path() / "capture", studioLamp());
    return capture;
}

// Stages shape and texels of these frames.
TrainResult trained(const Capture& seen, double lrLight, double lrGain, const fs::path& out) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = test::tinyPreset();
    avatar.preset.texture.textureSize = 128;
    avatar.preset.shape.steps = 60;
    avatar.preset.texels.samples = 1;
    avatar.preset.texels.steps = 280;
    avatar.preset.texels.lrLight = lrLight;
    avatar.preset.texels.lrGain = lrGain;
    TrainSettings settings;
    settings.out = out;
    settings.stages = {"shape", "texels"};
    settings.pictureSeconds = 1e9;
    return trainAvatar(testDevice(), std::move(avatar), seen, settings);
}

const std::vector<size_t> kEven{0, 2, 4, 6, 8, 10, 12, 14}, kOdd{1, 3, 5, 7, 9, 11, 13, 15};

double heldOut(const Avatar& avatar) {
    Capture unseen = turn().subset(kOdd);
    unseen.betas = avatar.betas;
    return meanMetrics(evaluateAvatar(testDevice(), avatar, unseen)).psnrBody;
}

// Texels that have moved by a tenth, and nothing else that costs: no mask, no picture.
double costOfMovedTexels(size_t frames, double weight) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    SurfacePreset preset;
    preset.size = 16;
    preset.batch = 1;
    preset.stayTexels = weight;
    SurfaceState state(testDevice(), body,
                       {.poses = std::vector<float>(frames * size_t(kPoseRow)),
                        .texels = std::vector<float>(3 * 32 * 32, .5f),
                        .textureSize = 32},
                       preset);
    state.texels.write(*state.texels.find("texels"), std::vector<float>(3 * 32 * 32, .1f));
    SurfaceStep step(testDevice(), body, state, preset);
    step.graph.setStep(adamwStepParams(1, 1, kSurfaceOptimiser));
    step.graph.write(step.poseSteps[0], wordsOf(adamwStepParams(1, 1, kPoseOptimiser)));
    step.graph.write(step.samples[0].camera, cameraValues({.fx = 16, .fy = 16}));
    step.graph.run();
    return step.losses.read().at(0);
}

TEST(Surface, HoldsTexelsLessTheMoreFramesThereAre) {
    const double one = costOfMovedTexels(1, 16) - costOfMovedTexels(1, 0);
    EXPECT_GT(one, .1);
    EXPECT_NEAR((costOfMovedTexels(8, 16) - costOfMovedTexels(8, 0)) / one, 1 / 8., 1e-3);
}

// A person whose texels are black and white by turns, before grey that the frame shows everywhere.
double costOfCheckers(size_t side) {
    constexpr size_t kSize = 32, kPixels = kSize * kSize;
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    SurfacePreset preset;
    preset.size = kSize;
    preset.batch = 1;
    preset.silhouette = 0;
    std::vector<float> pose(size_t(kPoseRow), 0.f), texels;
    pose[kThetaSize + 2] = 3;  // metres away
    for (size_t y = 0; y < side; ++y)
        for (size_t x = 0; x < side; ++x) texels.insert(texels.end(), 3, float((x + y) % 2));
    SurfaceState state(
        testDevice(), body,
        {.poses = pose, .texels = texels, .textureSize = int(side), .movesOffsets = true}, preset);
    SurfaceStep step(testDevice(), body, state, preset);
    step.graph.setStep(adamwStepParams(1, 1, kSurfaceOptimiser));
    step.graph.write(step.poseSteps[0], wordsOf(adamwStepParams(1, 1, kPoseOptimiser)));
    const SurfaceStep::Sample& sample = step.samples[0];
    const Camera camera{.fx = 40, .fy = 40, .cx = 16, .cy = 16, .width = 32, .height = 32};
    step.graph.write(sample.camera, cameraValues(rasterCamera(camera)));
    step.graph.write(sample.mask, std::vector<float>(kPixels, 1));
    step.graph.write(sample.counts, std::vector<float>(kPixels, 1));
    step.graph.write(sample.scale, std::vector<float>{1.f / kPixels});
    step.graph.write(sample.image, std::vector<float>(3 * kPixels, .5f));
    step.graph.write(sample.background, std::vector<float>(3 * kPixels, .5f));
    step.graph.run();
    return step.losses.read().at(0);
}

TEST(Surface, DrawsMeansOfTexelsSmallerThanHalfAPixel) {
    const double large = costOfCheckers(32), small = costOfCheckers(64);
    EXPECT_GT(large, .01);
    EXPECT_LT(small, large / 10);
}

TEST(Light, IsLearnedFromAPersonWhoTurns) {
    const test::Folder folder;
    const Capture seen = turn().subset(kEven);
    const Avatar with = trained(seen, .005, 0, folder / "with").avatar,
                 without = trained(seen, 0, 0, folder / "without").avatar;
    ASSERT_EQ(with.light.size(), kLightNumbers);
    EXPECT_TRUE(without.light.empty());
    // How much brighter the left is than the right, of what half faces the camera. How bright the
    // lamp is in front, nobody can tell: all that is seen faces the camera.
    auto contrast = [](const std::vector<float>& light, size_t c) {
        const double x = -.8, z = -.6;
        return 2 * (std::sqrt(3) * x * light[6 + c] + std::sqrt(15) * x * z * light[18 + c]);
    };
    const std::vector<float> truth = studioLamp();
    for (size_t c = 0; c < 3; ++c)
        EXPECT_NEAR(contrast(with.light, c), contrast(truth, c), .35 * contrast(truth, c));
    EXPECT_GT(contrast(with.light, 0), contrast(with.light, 2));  // warm
    // And frames that training did not see are better for it.
    const double dB = heldOut(with), plain = heldOut(without);
    EXPECT_GT(dB, plain + .3);

    // On disk and back, to the bit.
    const fs::path path = folder / "with";
    EXPECT_EQ(readAvatar(path).light, with.light);

    // A picture is under the light, or not; the texture is free of it either way.
    const Capture& capture = turn();
    Avatar albedo = with;
    albedo.light.clear();
    AvatarRenderer lit(testDevice(), with), plainly(testDevice(), albedo);
    const Theta& theta = capture.theta[0];
    const Trans& trans = capture.trans[0];
    const Camera& camera = capture.frames[0].camera;
    EXPECT_NE(lit.draw(theta, trans, camera).rgb, plainly.draw(theta, trans, camera).rgb);
    const std::vector<float> verts = lit.vertices(theta, trans);
    EXPECT_EQ(lit.texture(verts), plainly.texture(verts));

    // render asks which.
    auto rendered = [&](const std::string& light) {
        const std::string out = (folder / light).string();
        std::ostringstream said, errors;
        EXPECT_EQ(runCommandLine(
                      {"render", path.string(), "--motion", capture.folder.string(), "--frames",
                       "0", "--background", "#000000", "--light", light, "--out", out},
                      said, errors),
                  0)
            << errors.str();
        return readImage(picturesOfFolder(out).at(0), 3).data;
    };
    EXPECT_NE(rendered("capture"), rendered("none"));

    // What is not a light is refused with the file's name.
    const std::string toml = test::bytesOf(path / "avatar.toml");
    auto expectRefused = [&](const std::string& light, const std::string& found) {
        std::ofstream(path / "avatar.toml")
            << std::regex_replace(toml, std::regex("light = \\[[^\\]]*\\]"), "light = " + light);
        expectInputError([&] { readAvatar(path); }, found);
    };
    expectRefused("[ 1.0, 2.0 ]", "light: expected 24 numbers from -100 to 100, found 1 2");
    std::string many = "[ nan";
    for (size_t i = 1; i < kLightNumbers; ++i) many += ", 0.5";
    expectRefused(many + " ]", "light: expected 24 numbers from -100 to 100, found nan 0.5 0.5");
}

// What an automatic exposure and white balance make of frame f.
Gain exposure(size_t f) {
    const auto at = static_cast<float>(f);
    const float all = 1 + .15f * std::sin(1.3f * at), warm = .06f * std::cos(2.1f * at);
    return {all * (1 + warm), all, all * (1 - warm)};
}

TEST(Light, ExposuresOfFramesAreLearned) {
    const test::Folder folder;
    // Without the lamp: what it does to who turns looks like exposures.
    const Capture even = recorded(folder / "capture", {});
    for (size_t f = 0; f < even.size(); ++f) {
        const fs::path path = even.frames[f].image;
        Image image = readImage(path, 3);
        for (size_t i = 0; i < image.data.size(); ++i)
            image.data[i] = static_cast<uint8_t>(std::lround(
                std::min(255.0f, exposure(f)[i % 3] * .8f * static_cast<float>(image.data[i]))));
        writeImage(path, image);
    }
    const Capture drifting = readCapture(folder / "capture"), seen = drifting.subset(kEven);
    TrainResult with = trained(seen, .005, .01, folder / "with"),
                without = trained(seen, .005, 0, folder / "without");
    EXPECT_TRUE(without.capture.gains.empty());
    ASSERT_EQ(with.capture.gains.size(), seen.size());
    // How bright all frames are together is the texture's: gains are compared with each other.
    auto expectTruth = [&](const std::vector<Gain>& gains, const std::vector<size_t>& frames) {
        for (size_t c = 0; c < 3; ++c) {
            double truth = 0, found = 0;
            for (size_t k = 0; k < frames.size(); ++k)
                truth += exposure(frames[k])[c], found += gains[k][c];
            for (size_t k = 0; k < frames.size(); ++k)
                EXPECT_NEAR(gains[k][c] / found, exposure(frames[k])[c] / truth,
                            .06 * exposure(frames[k])[c] / truth)
                    << "frame " << frames[k] << ", channel " << c;
        }
    };
    expectTruth(with.capture.gains, kEven);
    auto body = [&](const Avatar& avatar, const Capture& capture) {
        return meanMetrics(evaluateAvatar(testDevice(), avatar, capture)).psnrBody;
    };
    EXPECT_GT(body(with.avatar, with.capture), body(without.avatar, without.capture) + 1);

    // Frames that training did not see: a fit to their pictures finds theirs.
    Capture unseen = drifting.subset(kOdd);
    unseen.betas = with.avatar.betas;
    fitPosesToPictures(testDevice(), with.avatar, unseen, 1);
    ASSERT_EQ(unseen.gains.size(), kOdd.size());
    expectTruth(unseen.gains, kOdd);

    // They are kept with the poses; what decodes frames takes them out.
    Capture again = drifting;
    EXPECT_EQ(takeTrainingPoses(folder / "with", again), seen.size());
    ASSERT_EQ(again.gains.size(), drifting.size());
    EXPECT_EQ(again.gains[0], with.capture.gains[0]);
    EXPECT_EQ(again.gains[1], (Gain{1, 1, 1}));
    EXPECT_EQ(again.subset(kEven).gains, with.capture.gains);
    FrameCache asRecorded(drifting), flattened(again);
    const std::vector<uint8_t> dark = asRecorded.load(2)->rgb, flat = flattened.load(2)->rgb;
    for (size_t i = 0; i < dark.size(); ++i)
        ASSERT_NEAR(flat[i], std::min(255.0f, static_cast<float>(dark[i]) / again.gains[2][i % 3]),
                    .51);
    Npz poses = readNpz(folder / "with" / "poses.npz");
    poses.set("gain", Array::f32({8, 3}, std::vector<float>(24)));
    writeNpz(folder / "with" / "poses.npz", poses, true);
    expectInputError([&] { takeTrainingPoses(folder / "with", again); },
                     "poses.npz: gain: expected numbers from 0.1 to 10, found 0 in frame 0");
}

}  // namespace
}  // namespace doppel
