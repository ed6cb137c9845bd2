// The runtime: hazards, reflection, memory plan, replay.
#include "engine/hazards.h"
#include "nn/elementwise.h"
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
