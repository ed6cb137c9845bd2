// doppel ablate in small: variants share what they have in common, and each is what training it
// alone would make.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/commands/ablate.h"
#include "trainer/commands/train.h"
#include "trainer/motion/synthetic.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;

Preset tinyPreset() {
    Preset preset = presetByName("ci");
    preset.fit.size = 64;
    preset.fit.passes = 2;
    preset.mesh.size = 64;
    preset.mesh.blocks = 1;
    preset.mesh.layers = 2;
    preset.mesh.hidden = 8;
    preset.mesh.steps = 6;
    preset.texture.size = 64;
    preset.texture.textureSize = 64;
    preset.texture.block = 1;
    preset.texture.depth = 6;
    preset.texture.width = 4;
    preset.texture.steps = 5;
    preset.refine.size = 64;
    preset.refine.width = 4;
    preset.refine.depth = 6;
    preset.refine.discriminatorWidth = 4;
    preset.refine.faceSize = 32;
    preset.refine.batch = 1;
    preset.refine.steps = 3;
    return preset;
}

TEST(Ablate, VariantsAreWhatTrainingAloneMakes) {
    test::Folder folder;
    Actor actor = readActor(assetFolder() / "actor", "woman");
    SyntheticOptions synthetic;
    synthetic.size = 96;
    synthetic.samples = 1;
    renderActor(testDevice(), actor, actorSession(5, 0, kActorDistance), folder / "capture",
                synthetic);

    AblateOptions options;
    options.capture = folder / "capture";
    options.out = folder / "out";
    options.body = "default";
    options.frames = "0:4";
    options.testFrames = "4";
    options.preset = tinyPreset();
    options.variants = {"complete", "no-clamp", "no-refine", "no-gan"};
    runAblate(options);

    const auto json = nlohmann::json::parse(bytesOf(folder / "out/ablation.json"));
    std::vector<std::string> names;
    for (const auto& row : json["rows"]) {
        names.push_back(row["name"]);
        EXPECT_EQ(row["frames"], 1);
        EXPECT_EQ(row["change_held_still"], 0);
        EXPECT_GT(row["ssim"], .5);
    }
    EXPECT_EQ(names, (std::vector<std::string>{"no-refine", "no-clamp", "complete", "no-gan"}));
    EXPECT_EQ(json["rows"][2]["paper"]["ssim"], .868);
    EXPECT_FALSE(json["rows"][3].contains("paper"));
    EXPECT_EQ(json["settings"]["test_poses"], "as given");
    EXPECT_FALSE(bytesOf(folder / "out/ablation.md").empty());

    // The same by doppel train.
    TrainOptions train;
    train.capture = options.capture;
    train.body = options.body;
    train.frames = options.frames;
    train.preset = options.preset;
    train.pictureSeconds = 0;
    train.stages = {"fit", "mesh", "texture", "refine"};
    train.out = folder / "alone";
    runTrain(train);
    for (const char* file : {"body.npz", "mesh_net.safetensors", "texture_net.safetensors",
                             "refine_net.safetensors", "texture.png", "texture_baked.png"}) {
        const std::string bytes = bytesOf(options.out / "complete" / file);
        EXPECT_FALSE(bytes.empty()) << file;
        EXPECT_EQ(bytes, bytesOf(train.out / file)) << file;
    }
    const fs::path out = options.out;
    EXPECT_NE(bytesOf(out / "complete/refine_net.safetensors"),
              bytesOf(out / "no-gan/refine_net.safetensors"));
    EXPECT_NE(bytesOf(out / "complete/mesh_net.safetensors"),
              bytesOf(out / "no-clamp/mesh_net.safetensors"));
    EXPECT_FALSE(fs::exists(out / "no-refine/refine_net.safetensors"));

    // What is there is taken as it is; other numbers are not.
    const auto when = fs::last_write_time(out / "complete/refine_net.safetensors");
    const std::string table = bytesOf(out / "ablation.csv");
    runAblate(options);
    EXPECT_EQ(fs::last_write_time(out / "complete/refine_net.safetensors"), when);
    EXPECT_EQ(bytesOf(out / "ablation.csv"), table);
    const auto coarse = fs::last_write_time(out / "no-refine/texture_net.safetensors");
    options.variants = {"complete"};
    options.preset.refine.steps = 4;
    runAblate(options);
    EXPECT_EQ(fs::last_write_time(out / "no-refine/texture_net.safetensors"), coarse);
    EXPECT_NE(fs::last_write_time(out / "complete/refine_net.safetensors"), when);
    EXPECT_EQ(nlohmann::json::parse(bytesOf(out / "ablation.json"))["rows"].size(), 1u);

    options.variants = {"no-body"};
    expectInputError([&] { runAblate(options); }, "--variants: expected some of");
}

}  // namespace
}  // namespace doppel
