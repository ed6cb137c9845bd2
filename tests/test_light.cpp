// The light of a capture: an actor who turns under a lamp, and what training makes of her with and
// without a light of its own; and how avatars keep it.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <regex>
#include <sstream>

#include "engine/io/image.h"
#include "nn/steps/light.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/commands/cli.h"
#include "trainer/data/frame_selection.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

// Sixteen frames of a turn under the lamp, in the actor's true poses.
const Capture& turn() {
    static const test::Folder folder;
    static const Capture capture = [] {
        SyntheticOptions options;
        options.size = 128;
        options.samples = 2;
        options.poseNoiseDegrees = options.transNoiseMetres = 0;
        options.light = studioLamp();
        return renderActor(testDevice(), readActor(assetFolder() / "actor", "woman"),
                           actorSession(16, 0, kActorDistance), folder.path() / "capture", options);
    }();
    return capture;
}

// Of every other frame, stages shape and texels.
Avatar trained(double lrLight, const fs::path& out) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = test::tinyPreset();
    avatar.preset.texture.textureSize = 128;
    avatar.preset.shape.steps = 60;
    avatar.preset.texels.samples = 1;
    avatar.preset.texels.steps = 200;
    avatar.preset.texels.lrLight = lrLight;
    TrainSettings settings;
    settings.out = out;
    settings.stages = {"shape", "texels"};
    settings.pictureSeconds = 1e9;
    return trainAvatar(testDevice(), std::move(avatar),
                       turn().subset(std::vector<size_t>{0, 2, 4, 6, 8, 10, 12, 14}), settings)
        .avatar;
}

double heldOut(const Avatar& avatar) {
    Capture unseen = turn().subset(std::vector<size_t>{1, 3, 5, 7, 9, 11, 13, 15});
    unseen.betas = avatar.betas;
    return meanMetrics(evaluateAvatar(testDevice(), avatar, unseen)).psnrBody;
}

TEST(Light, IsLearnedFromAPersonWhoTurns) {
    const test::Folder folder;
    const Avatar with = trained(.005, folder / "with"), without = trained(0, folder / "without");
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

}  // namespace
}  // namespace doppel
