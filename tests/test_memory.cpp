// --memory and --profile: what a stage takes, before and while it runs.
#include <gtest/gtest.h>

#include "nn/ops/elementwise.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/commands/train.h"
#include "trainer/motion/synthetic.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

TEST(Memory, BudgetCountsAllThatAGraphNeeds) {
    Parameters parameters;
    parameters.add("w", {1024, 256}, std::vector<float>(1024 * 256));
    parameters.allocate(testDevice());  // values, gradients and two moments: 4 MiB
    const auto compile = [&](uint64_t budget) {
        Graph graph(testDevice());
        graph.output(leakyRelu(graph, graph.parameter(parameters, "w"), .2f));  // 1 MiB
        graph.constant(std::vector<float>(1024 * 512), {1024, 512});            // 2 MiB
        graph.compile({.memoryBudget = budget});
    };
    compile(uint64_t{8} << 20);
    const std::string refusal = messageOf<InputError>([&] { compile(uint64_t{6} << 20); });
    EXPECT_EQ(refusal.find("this needs 7 MiB of device memory, 1 of them for activations, the "
                           "memory budget is 6 MiB; use a smaller preset or raise --memory"),
              0u)
        << refusal;
}

class Stages : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = new Folder;
        const Actor actor = readActor(assetFolder() / "actor", "woman");
        SyntheticOptions options;
        options.size = 64;
        renderActor(testDevice(), actor, actorSession(2, 0, kActorDistance), *folder_ / "capture",
                    options);
    }
    static void TearDownTestSuite() { delete folder_; }
    static TrainOptions options(const char* out) {
        TrainOptions options;
        options.capture = *folder_ / "capture";
        options.out = *folder_ / out;
        options.body = "default";
        options.stages = {"fit", "mesh", "texture", "refine"};
        Preset& preset = options.preset = presetByName("ci");
        preset.fit.size = preset.mesh.size = preset.texture.size = preset.refine.size = 64;
        preset.mesh.blocks = 1;
        preset.mesh.layers = 2;
        preset.mesh.hidden = 16;
        preset.texture.textureSize = 64;
        preset.texture.block = 1;
        preset.texture.depth = preset.refine.depth = 6;
        preset.texture.width = preset.refine.width = 4;
        preset.refine.discriminatorWidth = 2;
        preset.refine.faceSize = 16;
        return options;
    }
    static Folder* folder_;
};
Folder* Stages::folder_;

TEST_F(Stages, TooLittleMemoryIsRefusedBeforeAnyWork) {
    TrainOptions little = options("little");
    little.memoryBudget = 1 << 20;
    EXPECT_EQ(messageOf<InputError>([&] { runTrain(little); })
                  .find("--memory: stage fit: this "
                        "needs "),
              0u);
    EXPECT_FALSE(fs::exists(little.out));
    // The last stage alone is too large: nor is there anything then of those before it.
    little.memoryBudget = uint64_t{64} << 20;
    little.preset.refine.width = 128;
    EXPECT_EQ(messageOf<InputError>([&] { runTrain(little); }).find("--memory: stage refine: "),
              0u);
    EXPECT_FALSE(fs::exists(little.out));
}

TEST_F(Stages, ProfileShowsEachOfThem) {
    TrainOptions profiled = options("profiled");
    profiled.profileSteps = 1;
    testing::internal::CaptureStdout();
    runTrain(profiled);
    const std::string printed = testing::internal::GetCapturedStdout();
    for (const char* stage : {"fit", "mesh", "texture", "refine"}) {
        EXPECT_NE(printed.find(fmt::format("stage {}: ", stage)), std::string::npos) << printed;
        EXPECT_NE(printed.find(fmt::format("stage {} ", stage)), std::string::npos) << printed;
    }
    EXPECT_FALSE(fs::exists(profiled.out));
}

}  // namespace
}  // namespace doppel
