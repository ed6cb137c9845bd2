#include "nn/nets/texture_unet.h"

#include <cmath>

#include "nn/core/initialise.h"
#include "tests/files.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

// tests/networks/*.npz: PyTorch's numbers (float64, rounded) for networks of width 4 on 32x32.
void checkAgainst(const std::string& file, int64_t inputChannels) {
    Npz golden = readNpz(test::sourceFolder() / "tests/networks" / file);
    TextureUnet net({.size = 32, .width = 4, .inputChannels = inputChannels}, "texture", 1);
    net.allocate(testDevice());
    size_t given = 0;
    for (const auto& [name, array] : golden) given += name.starts_with("param.");
    ASSERT_EQ(net.parameters().entries().size(), given);
    for (const Parameters::Entry& entry : net.parameters().entries()) {
        ASSERT_TRUE(golden.has("param." + entry.name)) << entry.name;
        ASSERT_EQ(golden.at("param." + entry.name).shape, entry.shape) << entry.name;
        net.parameters().write(entry, golden.at("param." + entry.name).toF32());
    }

    Graph graph(testDevice());
    Tensor x = graph.variable(golden.at("x").shape);
    Tensor y = net.forward(graph, x, {.training = true, .dropout = false});
    Tensor dy = graph.input(golden.at("grad_y").shape);
    graph.backward({{y, dy}});
    graph.output(y);
    Tensor dx = graph.gradient(x);
    graph.output(dx);
    graph.compile({.poison = true});
    graph.write(x, golden.at("x").toF32());
    graph.write(dy, golden.at("grad_y").toF32());
    graph.run();

    auto error = [&](const std::vector<float>& got, const std::string& name) {
        return relativeError({got.begin(), got.end()}, golden.at(name).toF64(), 1e-12);
    };
    EXPECT_LE(error(graph.read(y), "y"), 1e-5);
    EXPECT_LE(error(graph.read(dx), "grad_x"), 1e-4);
    std::vector<std::vector<float>> first;
    for (const Parameters::Entry& entry : net.parameters().entries()) {
        first.push_back(net.parameters().read(entry, Parameters::kGradient));
        EXPECT_LE(error(first.back(), "grad." + entry.name), 1e-4) << entry.name;
    }
    graph.run();
    size_t i = 0;
    for (const Parameters::Entry& entry : net.parameters().entries())
        EXPECT_EQ(net.parameters().read(entry, Parameters::kGradient), first[i++])
            << entry.name << ": the same bits every run";
}

TEST(TextureUnet, CoarseAgreesWithPytorch) { checkAgainst("texture_unet.npz", 3); }
TEST(TextureUnet, RefinementAgreesWithPytorch) { checkAgainst("refine_unet.npz", 4); }

TEST(TextureUnet, EvaluationUsesTheRunningStatistics) {
    // Statistics settle on those of one batch, so that both modes come to agree.
    TextureUnet net({.size = 8, .width = 3, .inputChannels = 1}, "texture", 7);
    net.allocate(testDevice());
    Graph graph(testDevice());
    Tensor x = graph.input({3, 1, 8, 8});
    Tensor training = net.forward(graph, x, {.training = true});
    Tensor evaluation = net.forward(graph, x, {});
    graph.output(training);
    graph.output(evaluation);
    graph.compile({.poison = true});
    Value values = random({3, 1, 8, 8});
    graph.write(x, std::vector<float>(values.data.begin(), values.data.end()));
    graph.run();
    auto difference = [&] {
        std::vector<float> a = graph.read(training), b = graph.read(evaluation);
        return relativeError({a.begin(), a.end()}, {b.begin(), b.end()}, 1e-6);
    };
    EXPECT_GT(difference(), 0.3);
    for (int step = 0; step < 250; ++step) graph.run();
    // What is left is the unbiased variance: 12 values per channel at the innermost.
    EXPECT_LT(difference(), 0.1);
}

TEST(TextureUnet, DropoutChangesFromStepToStep) {
    TextureUnet net({.size = 16, .width = 2}, "texture", 7);
    net.allocate(testDevice());
    Graph graph(testDevice());
    Tensor x = graph.input({1, 1, 16, 16});
    Tensor y = net.forward(graph, x, {.training = true, .dropout = true});
    graph.output(y);
    graph.compile();
    graph.write(x, std::vector<float>(256, 1.0f));
    auto run = [&](uint32_t step) {
        graph.setStep({.step = step, .seed = 3});
        graph.run();
        return graph.read(y);
    };
    std::vector<float> first = run(1);
    EXPECT_NE(run(2), first);
    EXPECT_EQ(run(1), first);
}

TEST(TextureUnet, ShapesOfThePaper) {
    TextureUnet net({}, "texture", 1);
    EXPECT_EQ(net.config().downs, 9);
    auto shape = [&](const char* name) {
        const Parameters::Entry* entry = net.parameters().find(name);
        return entry ? entry->shape : Shape{};
    };
    EXPECT_EQ(shape("enc1.weight"), (Shape{64, 1, 4, 4}));
    EXPECT_EQ(shape("enc4.weight"), (Shape{512, 256, 4, 4}));
    EXPECT_EQ(shape("enc9.weight"), (Shape{512, 512, 4, 4}));
    EXPECT_EQ(shape("dec1.weight"), (Shape{512, 512, 4, 4}));
    EXPECT_EQ(shape("dec2.weight"), (Shape{1024, 512, 4, 4}));
    EXPECT_EQ(shape("dec9.weight"), (Shape{128, 3, 4, 4}));
    EXPECT_EQ(shape("enc1_bn.weight"), Shape{});
    EXPECT_EQ(shape("enc9_bn.weight"), Shape{});
    EXPECT_EQ(shape("dec9.bias"), (Shape{3}));
}

// A network of zeros adds nothing to the texels that it paints over, for every map of a batch; one
// with weights adds something, and not without bound. One that takes blocks of texels paints as
// many.
class PaintsOverTexels : public testing::TestWithParam<int64_t> {};

TEST_P(PaintsOverTexels, AndAddsWhatItsWeightsSay) {
    const int64_t block = GetParam();
    const Value texels = uniform({16, 16, 3}, 0, 1, 4);
    const std::vector<float> given(texels.data.begin(), texels.data.end());
    for (std::optional<uint32_t> seed : {std::optional<uint32_t>(), std::optional<uint32_t>(3)}) {
        TextureUnet net({.size = 16, .width = 3, .block = block}, "texture", seed, given);
        net.allocate(testDevice());
        EXPECT_EQ(net.config().downs, block == 1 ? 4 : 3);
        EXPECT_EQ(net.parameters().find("enc1.weight")->shape[1], 4 * block * block);
        Graph graph(testDevice());
        Tensor maps = graph.constant(std::vector<float>(2 * 256, 1.0f), {2, 1, 16, 16});
        Tensor y = net.forward(graph, maps, {.training = true});
        graph.output(y);
        graph.compile({.poison = true});
        graph.run();
        const std::vector<float> painted = graph.read(y);
        double most = 0;
        for (size_t i = 0; i < painted.size(); ++i) {
            const size_t plane = i / 256 % 3, texel = i % 256;
            const double under = 2 * double{given[3 * texel + plane]} - 1;
            most = std::max(most, std::abs(double{painted[i]} - under));
        }
        if (seed)
            EXPECT_GT(most, 1e-3);
        else
            EXPECT_LT(most, 1e-6);
        EXPECT_LE(most, .5 + 1e-6);
    }
}

INSTANTIATE_TEST_SUITE_P(TextureUnet, PaintsOverTexels, testing::Values(1, 2));

TEST(TextureUnet, RefusesASizeThatIsNoPowerOfTwo) {
    expectInputError([] { TextureUnet({.size = 16, .block = 3}, "texture", 1); },
                     "blocks of 3 do not divide a size of 16");
    expectInputError([] { TextureUnet({.size = 96}, "texture", 1); }, "do not divide a size of 96");
    TextureUnet fewer({.size = 96, .width = 2, .downs = 5}, "texture", 1);
    EXPECT_EQ(fewer.config().downs, 5);
}

TEST(Initialise, IsTheSameEverywhere) {
    std::vector<float> values = normalValues(1, "enc1.weight", 100000, 1, 0.02f);
    std::vector<float> head(values.begin(), values.begin() + 3);
    EXPECT_EQ(head, (std::vector<float>{1.03606415f, 1.01567936f, 1.06077421f}));
    double mean = 0, variance = 0;
    for (float v : values) mean += v / 1e5;
    for (float v : values) variance += std::pow(v - mean, 2) / 1e5;
    EXPECT_NEAR(mean, 1, 4 * 0.02 / std::sqrt(1e5));
    EXPECT_NEAR(std::sqrt(variance), 0.02, 2e-4);
    EXPECT_NE(normalValues(1, "enc2.weight", 3, 1, 0.02f), head);
    EXPECT_NE(normalValues(2, "enc1.weight", 3, 1, 0.02f), head);
    EXPECT_EQ(normalValues(1, "enc1.weight", 3, 1, 0.02f), head);
}

}  // namespace
}  // namespace doppel
