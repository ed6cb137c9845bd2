// The runtime: hazards, reflection, memory plan, replay.
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <set>

#include "engine/cooperative_matrix.h"
#include "engine/hazards.h"
#include "engine/instance.h"
#include "nn/ops/elementwise.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

constexpr bool kReads = true, kWrites = true;

TEST(Hazards, BarriersWhereAccessesMeet) {
    HazardTracker tracker;
    EXPECT_FALSE(tracker.needsBarrier({{0, 16, kReads, false}}));
    tracker.add({{0, 16, kReads, false}, {16, 32, false, kWrites}});
    EXPECT_FALSE(tracker.needsBarrier({{0, 16, kReads, false}})) << "read after read";
    EXPECT_TRUE(tracker.needsBarrier({{16, 20, kReads, false}})) << "read after write";
    EXPECT_TRUE(tracker.needsBarrier({{31, 64, false, kWrites}})) << "write after write";
    EXPECT_TRUE(tracker.needsBarrier({{8, 9, false, kWrites}})) << "write after read";
    EXPECT_FALSE(tracker.needsBarrier({{32, 64, kReads, kWrites}})) << "neighbours do not meet";
    tracker.clear();
    EXPECT_FALSE(tracker.needsBarrier({{16, 20, kReads, kWrites}}));
}

TEST(Kernels, ReflectionAndLimits) {
    for (const ShaderTableRow& row : shaderTable()) {
        SCOPED_TRACE(row.name);
        Reflection reflection = reflect(row.descriptors);
        EXPECT_FALSE(reflection.buffers.empty());
        EXPECT_LE(reflection.slotCount * 8, kPushConstantBytes);
        bool writes = false;
        for (const KernelBuffer& buffer : reflection.buffers) writes |= buffer.writes;
        EXPECT_TRUE(writes) << "a kernel writes something";
    }
    auto row = std::ranges::find(shaderTable(), std::string_view("elementwise/multiply.forward"),
                                 &ShaderTableRow::name);
    Reflection reflection = reflect(row->descriptors);
    ASSERT_EQ(reflection.buffers.size(), 3u);
    EXPECT_EQ(reflection.buffers[0].name, "a");
    EXPECT_TRUE(reflection.buffers[0].reads && !reflection.buffers[0].writes);
    EXPECT_EQ(reflection.buffers[2].name, "y");
    EXPECT_TRUE(!reflection.buffers[2].reads && reflection.buffers[2].writes);
}

// Few devices have cooperative matrices; that their kernel's module is whole is seen on any.
TEST(Kernels, CooperativeMatrixTypesAreCompleted) {
    constexpr uint32_t kTypeInt = 21, kTypeFloat = 22, kConstant = 43, kSpecConstant = 50,
                       kTypeCooperativeMatrix = 4456;
    auto row = std::ranges::find(shaderTable(), std::string_view("linalg/gemm_matrix.tile"),
                                 &ShaderTableRow::name);
    auto plain = std::ranges::find(shaderTable(), std::string_view("linalg/gemm_staged.tile"),
                                   &ShaderTableRow::name);
    EXPECT_FALSE(usesCooperativeMatrices(plain->addresses));
    for (SpirvRange given : {row->addresses, row->descriptors}) {
        ASSERT_TRUE(usesCooperativeMatrices(given));
        std::vector<uint32_t> module = completeMatrixTypes(given);
        ASSERT_TRUE(std::equal(given.begin, given.begin + 3, module.begin()));
        // What each id is, once it has been declared; a constant's value; a float's bits.
        std::map<uint32_t, std::pair<uint32_t, uint32_t>> declared;
        std::set<uint32_t> uses;
        size_t at = 5, instructions = 0;
        for (; at < module.size(); at += module[at] >> 16, ++instructions) {
            const uint32_t* word = module.data() + at;
            uint32_t op = *word & 0xffff, length = *word >> 16;
            ASSERT_GT(length, 0u);
            ASSERT_LE(at + length, module.size());
            if (op == kTypeInt || op == kTypeFloat) declared[word[1]] = {op, word[2]};
            if (op == kConstant || op == kSpecConstant) {
                EXPECT_TRUE(declared.contains(word[1])) << "a constant's type comes before it";
                EXPECT_LT(word[2], module[3]) << "ids are below the bound";
                declared[word[2]] = {op, word[3]};
            }
            if (op != kTypeCooperativeMatrix) continue;
            ASSERT_EQ(length, 7u);
            for (uint32_t i = 2; i < 7; ++i)
                ASSERT_TRUE(declared.contains(word[i])) << "operand " << i << " comes before";
            uint32_t use = declared[word[6]].second;
            EXPECT_EQ(declared[word[2]], std::pair(kTypeFloat, use == 2 ? 32u : 16u));
            EXPECT_EQ(declared[word[3]].second, 3u) << "a subgroup's scope";
            EXPECT_EQ(declared[word[4]].first, kSpecConstant) << "rows";
            EXPECT_EQ(declared[word[5]].first, kSpecConstant) << "columns";
            EXPECT_EQ(declared[word[6]].first, kConstant);
            uses.insert(use);
        }
        EXPECT_EQ(at, module.size());
        EXPECT_EQ(uses, (std::set<uint32_t>{0, 1, 2}));
    }
}

// Buffers that are read as texels are told from the others, and have a descriptor in either
// flavour.
TEST(Kernels, ReflectsTexels) {
    auto row = std::ranges::find(shaderTable(), std::string_view("mesh/graph_panels.gather@cpu"),
                                 &ShaderTableRow::name);
    Reflection reflection = reflect(row->descriptors);
    EXPECT_TRUE(reflection.texels);
    for (const KernelBuffer& buffer : reflection.buffers) {
        EXPECT_EQ(buffer.texels, buffer.name == "quads") << buffer.name;
        if (buffer.texels) {
            EXPECT_TRUE(buffer.reads);
            EXPECT_FALSE(buffer.writes);
        }
    }
    auto plain = std::ranges::find(shaderTable(), std::string_view("mesh/graph_panels.gather"),
                                   &ShaderTableRow::name);
    EXPECT_FALSE(reflect(plain->descriptors).texels);
}

// Compiled functions of one width of vectors crash programs with another; so each width has a cache
// of its own, also in a program that another one starts.
TEST(Instance, KeepsACachePerWidthOfVectors) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");
    auto cacheFor = [](const char* width, const std::string& base) {
        setenv("LP_NATIVE_VECTOR_WIDTH", width, 1);
        setenv("MESA_SHADER_CACHE_DIR", base.c_str(), 1);
        separateShaderCaches();
        const char* now = std::getenv("MESA_SHADER_CACHE_DIR");
        fmt::print(stderr, "cache {}\n", now);
        std::exit(std::filesystem::is_directory(now) ? 0 : 1);
    };
    // The same folder in the processes of this test, another one where the test runs beside itself
    // with other bindings, kernels or drivers.
    std::string base = testing::TempDir() + "doppel_cache";
    for (const char* name : {"DOPPEL_BINDING", "DOPPEL_KERNELS", "VK_DRIVER_FILES"})
        if (const char* set = std::getenv(name))
            base += "_" + std::filesystem::path(set).stem().string();
    EXPECT_EXIT(cacheFor("256", base), testing::ExitedWithCode(0),
                "cache .*doppel_cache[^/]*/256-bit-vectors\n");
    EXPECT_EXIT(cacheFor("512", base + "/256-bit-vectors"), testing::ExitedWithCode(0),
                "cache .*doppel_cache[^/]*/512-bit-vectors\n");
    std::filesystem::remove_all(base);
}

// A chain of ops needs room for few tensors at a time.
TEST(GraphMemory, SharesAndStaysRight) {
    std::vector<float> x(1000);
    for (size_t i = 0; i < x.size(); ++i) x[i] = static_cast<float>(i) - 500;
    std::vector<float> results[2];
    uint64_t bytes[2];
    for (bool reuse : {false, true}) {
        Graph graph(testDevice());
        Tensor in = graph.input({1000}), y = in;
        for (int i = 0; i < 10; ++i) y = leakyRelu(graph, y, 0.9f);
        graph.output(y);
        graph.compile({.reuseMemory = reuse});
        graph.write(in, x);
        graph.run();
        results[reuse] = graph.read<float>(y);
        bytes[reuse] = graph.temporaryBytes();
    }
    EXPECT_EQ(results[0], results[1]);
    EXPECT_LT(bytes[1], bytes[0] / 3);
}

TEST(GraphReplay, TwoInFlightSeeTheirOwnInputs) {
    Graph graph(testDevice());
    Tensor x = graph.input({4}), y = leakyRelu(graph, x, 0.5f);
    graph.output(y);
    graph.compile();
    for (float i = 0; i < 5; ++i) {
        graph.write(x, std::vector<float>{i, -i, 2 * i, 1});
        graph.submit();
        if (i >= 3) {
            std::vector<float> expected{i, -i / 2, 2 * i, 1};
            EXPECT_EQ(graph.read<float>(y), expected);
            float before = i - 1;
            expected = {before, -before / 2, 2 * before, 1};
            EXPECT_EQ(graph.read<float>(y, 1), expected) << "of the replay before";
        }
    }
}

// No descriptor can describe an empty range, and no command fills or copies one: the runtime has to
// do without. Validation listens.
TEST(EmptyTensors, GoThroughKernelsCopiesAndFills) {
    Graph graph(testDevice());
    Tensor x = graph.variable({0, 5});
    Tensor whole = graph.variable({4, 8});
    Tensor y = leakyRelu(graph, x, 0.5f);
    Tensor z = leakyRelu(graph, y, 0.5f);
    Tensor end = leakyRelu(graph, whole.slice(4, 0), 0.5f);  // behind the last row
    Tensor copied = graph.temporary({0, 5}), filled = graph.temporary({0, 5});
    graph.copy(y, copied);
    graph.fill(filled, 7);
    Tensor upstream = graph.input({0, 5});
    graph.backward({{z, upstream}});
    Tensor dx = graph.gradient(x);
    for (const Tensor& tensor : {z, end, copied, filled, dx}) graph.output(tensor);
    graph.compile({.poison = true});
    graph.write(x, std::vector<float>{});
    graph.write(whole, std::vector<float>(32, 1));
    for (int i = 0; i < 2; ++i) graph.run();
    for (const Tensor& tensor : {z, end, copied, filled, dx})
        EXPECT_TRUE(graph.read<float>(tensor).empty());
    checkOp("leaky_relu", {.inputs = {{"x", random({3, 0})}},
                           .attributes = {{"slope", 0.2}},
                           .reference = [](const Values& v) -> Values {
                               return {{"y", v.at("x")}};
                           }});
}

// A tensor with two readers gets the sum of both gradients.
TEST(GraphReverse, SumsGradients) {
    Graph graph(testDevice());
    Tensor x = graph.variable({1});
    Tensor a = leakyRelu(graph, x, 0.5f), b = leakyRelu(graph, x, 0.25f);
    Tensor c = leakyRelu(graph, a, 0.5f);
    Tensor one = graph.input({1});
    graph.backward({{b, one}, {c, one}});
    Tensor dx = graph.gradient(x);
    graph.output(dx);
    graph.compile();
    graph.write(one, std::vector<float>{1});
    graph.write(x, std::vector<float>{-3});
    graph.run();
    EXPECT_FLOAT_EQ(graph.readScalar(dx), 0.5f);
}

}  // namespace
}  // namespace doppel
