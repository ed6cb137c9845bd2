// The tuning cache, and products under other tiles than the table's.
#include "nn/core/tuning.h"

#include <fstream>

#include "nn/ops/linalg.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

std::filesystem::path scratchFile(const std::string& name) {
    std::filesystem::path path = std::filesystem::temp_directory_path() /
                                 fmt::format("doppel-tuning-{}-{}", name, ::getpid());
    std::filesystem::remove(path);
    return path;
}

DeviceInfo named(const std::string& name, bool cpu) {
    DeviceInfo info;
    info.name = name;
    info.driver = "driver 1";
    info.cpu = info.kernelPath.onCpu = cpu;
    return info;
}

TEST(Tuning, ReadsWhatItWroteAndKeepsOtherDevices) {
    std::filesystem::path path = scratchFile("round");
    GemmTuning one{.cost8 = 1.5, .cost16 = 1.1, .tiles = 32, .shortestPart = 256};
    GemmTuning two{.tiles = 1024, .shortestPart = 64};
    writeGemmTuning(path, named("a", true), one);
    writeGemmTuning(path, named("b", false), one);
    writeGemmTuning(path, named("b", false), two);
    EXPECT_EQ(readGemmTuning(path, named("a", true)), one);
    EXPECT_EQ(readGemmTuning(path, named("b", false)), two);
    EXPECT_EQ(readGemmTuning(path, named("c", true)), defaultGemmTuning(DeviceClass::Cpu));
    std::filesystem::remove(path);
}

TEST(Tuning, NamesTheLineThatIsWrong) {
    for (const char* wrong : {"cost8=.01", "tiles=", "tiles=-1", "speed=3", "tiles=2x", "nonsense"}) {
        std::filesystem::path path = scratchFile("wrong");
        std::ofstream(path) << "\"x\" \"y\" tiles=8\n\"a\" \"driver 1\" " << wrong << "\n";
        try {
            readGemmTuning(path, named("a", false));
            ADD_FAILURE() << wrong;
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find("line 2"), std::string::npos) << error.what();
        }
        std::filesystem::remove(path);
    }
}

// Every variant makes the same product, and the same variant the same bits.
TEST(Tuning, VariantsAgree) {
    constexpr int64_t m = 137, n = 150, k = 700;
    std::vector<float> a, b;
    for (int64_t i = 0; i < m * k; ++i) a.push_back(float((i * 7919) % 201 - 100) / 100);
    for (int64_t i = 0; i < k * n; ++i) b.push_back(float((i * 104729) % 199 - 99) / 100);
    const GemmTuning before = gemmTuning(testDevice());
    auto product = [&](const GemmTuning& tuning) {
        setGemmTuning(testDevice(), tuning);
        Graph graph(testDevice());
        Tensor c = graph.temporary({m, n});
        graph.beginOp("product");
        gemm(graph, graph.constant(std::span<const float>(a), {m, k}),
             graph.constant(std::span<const float>(b), {k, n}), c, {.m = m, .n = n, .k = k});
        graph.output(c);
        graph.compile({.poison = true});
        graph.run();
        return graph.read<float>(c);
    };
    std::vector<double> expected(size_t(m * n));
    for (int64_t i = 0; i < m; ++i)
        for (int64_t j = 0; j < n; ++j)
            for (int64_t l = 0; l < k; ++l)
                expected[size_t(i * n + j)] +=
                    double(a[size_t(i * k + l)]) * double(b[size_t(l * n + j)]);
    for (GemmTuning tuning :
         {GemmTuning{}, GemmTuning{.cost8 = .1}, GemmTuning{.cost16 = .1},
          GemmTuning{.tiles = 64, .shortestPart = 16},
          GemmTuning{.tiles = 1, .shortestPart = 4096}}) {
        std::vector<float> got = product(tuning);
        EXPECT_EQ(got, product(tuning));
        for (size_t i = 0; i < got.size(); ++i)
            ASSERT_NEAR(double(got[i]), expected[i], 1e-3) << i << " of tiles " << tuning.tiles;
    }
    setGemmTuning(testDevice(), before);
}

}  // namespace
}  // namespace doppel
