// The whole job in small: a capture of the synthetic actor, fit, mesh, texture, an avatar on disk.
#include "trainer/train.h"

#include <gtest/gtest.h>

#include <fstream>
#include <numeric>

#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/evaluate.h"
#include "trainer/synthetic.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

Preset tinyPreset() {
    Preset preset = presetByName("ci");
    preset.fit.size = 128;
    preset.fit.passes = 12;
    preset.mesh.size = 128;
    preset.mesh.blocks = 1;
    preset.mesh.layers = 2;
    preset.mesh.hidden = 16;
    preset.mesh.steps = 25;
    preset.texture.size = 64;
    preset.texture.textureSize = 64;
    preset.texture.depth = 6;
    preset.texture.width = 4;
    preset.texture.steps = 80;
    return preset;
}

Capture tinyCapture(const fs::path& folder) {
    Actor actor = readActor(assetFolder() / "actor", "woman");
    SyntheticOptions options;
    options.size = 128;
    options.samples = 2;
    return renderActor(testDevice(), actor, actorSession(6, 0, kActorDistance), folder, options);
}

TrainResult trainTiny(const Capture& capture, const fs::path& out) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = tinyPreset();
    TrainSettings settings;
    settings.out = out;
    settings.pictureSeconds = 0;
    return trainAvatar(testDevice(), std::move(avatar), capture, settings);
}

std::string bytesOf(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

TEST(Train, LearnsAndRepeatsItselfToTheByte) {
    test::Folder folder;
    Capture capture = tinyCapture(folder.path() / "capture");
    ASSERT_EQ(capture.size(), 6u);
    TrainResult first = trainTiny(capture, folder.path() / "a");
    ASSERT_TRUE(first.fit);
    EXPECT_GT(first.fit->iouAfter, first.fit->iouBefore + 0.04);

    // The mesh network moves vertices, and not away from the masks.
    double fitted = mean(avatarIous(testDevice(), first.avatar, first.capture, false));
    double refined = mean(avatarIous(testDevice(), first.avatar, first.capture, true));
    EXPECT_NEAR(fitted, first.fit->iouAfter, 1e-9);
    EXPECT_NE(refined, fitted);
    EXPECT_GT(refined, fitted - 0.003);
    // The texture beats a grey one.
    FrameMetrics metrics = meanMetrics(evaluateAvatar(testDevice(), first.avatar, first.capture));
    Avatar grey = first.avatar;
    std::fill(grey.texture.begin(), grey.texture.end(), 0.5f);
    EXPECT_GT(metrics.psnrBody,
              meanMetrics(evaluateAvatar(testDevice(), grey, first.capture)).psnrBody + 1);

    // On disk and back.
    Avatar read = readAvatar(folder.path() / "a");
    EXPECT_EQ(read.betas, first.avatar.betas);
    EXPECT_EQ(read.preset.mesh.hidden, 16);
    EXPECT_EQ(avatarIous(testDevice(), read, first.capture, true),
              avatarIous(testDevice(), first.avatar, first.capture, true));
    EXPECT_FALSE(fs::exists(folder.path() / "a" / "checkpoints" / "mesh.safetensors"));

    // The same seed twice.
    trainTiny(capture, folder.path() / "b");
    for (const char* name : {"mesh_net.safetensors", "texture_net.safetensors", "texture.png"}) {
        std::string a = bytesOf(folder.path() / "a" / name);
        EXPECT_FALSE(a.empty()) << name;
        EXPECT_EQ(a, bytesOf(folder.path() / "b" / name)) << name;
    }
}

TEST(Train, RefusesWhatIsNoAvatar) {
    test::Folder folder;
    expectInputError([&] { readAvatar(folder.path()); }, "avatar.toml");
    expectInputError([&] { readBodyArrays("nobody"); }, "--body");
}

}  // namespace
}  // namespace doppel
