#include "nn/ops/elementwise.h"

#include <cmath>

#include "common/blocks.h"
#include "common/random.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

constexpr int64_t kInvocation = 2 * kPairsEach;              // elements of an invocation
constexpr int64_t kWorkgroup = 64 * kInvocation;             // of a workgroup
constexpr int64_t kSubgroup = kBlocksEach * kBlockElements;  // of a subgroup that takes blocks

// The edges of an invocation and of a workgroup; wholes of blocks by workgroups of sixteen
// subgroups and of four (nn/ops/blocks.h), and an element less and more than these.
std::vector<Shape> shapes() {
    std::vector<Shape> all{{13}, {2, 3, 127}, {64, kSubgroup}, {68, kSubgroup}};
    for (int64_t tile : {kInvocation, kWorkgroup})
        for (int64_t n : edgeSizes(tile)) all.push_back({n});
    for (int64_t n : {64 * kSubgroup - 1, 68 * kSubgroup + 1}) all.push_back({n});
    return all;
}

// One input x, one output y of the same shape.
Values mapX(const Values& v, const std::function<double(double)>& f) {
    Value y = v.at("x");
    for (double& value : y.data) value = f(value);
    return {{"y", y}};
}

void checkMap(const std::string& op, const std::function<double(double)>& f,
              const std::map<std::string, double>& attributes = {}) {
    for (const Shape& shape : shapes())
        checkOp(op, {.inputs = {{"x", random(shape)}},
                     .attributes = attributes,
                     .reference = [&](const Values& v) { return mapX(v, f); }});
}

TEST(Elementwise, LeakyRelu) {
    checkMap("leaky_relu", [](double x) { return x > 0 ? x : 0.2 * x; }, {{"slope", 0.2}});
}
TEST(Elementwise, Relu) {
    checkMap("relu", [](double x) { return x > 0 ? x : 0; });
}
TEST(Elementwise, Tanh) {
    checkMap("tanh", [](double x) { return std::tanh(x); });
}
TEST(Elementwise, Sigmoid) {
    checkMap("sigmoid", [](double x) { return 1 / (1 + std::exp(-x)); });
}
TEST(Elementwise, ScaleShift) {
    checkMap("scale_shift", [](double x) { return 0.5 * x + 0.25; },
             {{"scale", 0.5}, {"shift", 0.25}});
}
TEST(Elementwise, Clamp) {
    checkMap("clamp", [](double x) { return std::clamp(x, -0.5, 0.75); },
             {{"low", -0.5}, {"high", 0.75}});
}

TEST(Elementwise, FarFromZero) {
    Npz in;
    in.set("x", Array::f32({4}, std::vector<float>{-200, -50, 50, 200}));
    in.set("grad_y", Array::f32({4}, std::vector<float>(4, 1)));
    for (const char* op : {"sigmoid", "tanh"}) {
        Npz out = Op::find(op)->run(testDevice(), in, {});
        double low = std::string(op) == "tanh" ? -1 : 0;
        EXPECT_NEAR(out.at("y").toF64()[0], low, 1e-6) << op;
        EXPECT_NEAR(out.at("y").toF64()[3], 1, 1e-6) << op;
        for (double g : out.at("grad_x").toF64()) EXPECT_NEAR(g, 0, 1e-6) << op;
    }
}

void checkPointwise(const char* op, double (*f)(double, double)) {
    for (const Shape& shape : shapes())
        checkOp(op, {.inputs = {{"a", random(shape, 1)}, {"b", random(shape, 2)}},
                     .reference = [&](const Values& v) -> Values {
                         Value y = v.at("a");
                         for (size_t i = 0; i < y.data.size(); ++i)
                             y.data[i] = f(y.data[i], v.at("b").data[i]);
                         return {{"y", y}};
                     }});
}

TEST(Elementwise, Add) {
    checkPointwise("add", [](double a, double b) { return a + b; });
}
TEST(Elementwise, Multiply) {
    checkPointwise("multiply", [](double a, double b) { return a * b; });
}

TEST(Elementwise, SumWithItself) {
    // Both gradients land in the same tensor.
    Graph graph(testDevice());
    Tensor x = graph.variable({3});
    Tensor y = add(graph, x, multiply(graph, x, x));
    Tensor up = graph.input({3});
    graph.backward({{y, up}});
    graph.output(graph.gradient(x));
    Tensor dx = graph.gradient(x);
    graph.compile({.poison = true});
    graph.write(x, std::vector<float>{1, 2, -3});
    graph.write(up, std::vector<float>{1, 1, 2});
    graph.run();
    EXPECT_EQ(graph.read(dx), (std::vector<float>{3, 5, -10}));
}

void checkConcat(const char* op, bool relu) {
    struct Case {
        Shape a, b;
        int axis;
    };
    std::vector<Case> cases = {{{1, 1}, {1, 1}, 1},
                               {{13, 7}, {13, 3}, 1},
                               {{2, 3, 5, 7}, {2, 1, 5, 7}, 1},
                               {{2, 3, 5, 8}, {2, 5, 5, 8}, 1},
                               {{3, 4}, {2, 4}, 0},
                               {{2, 18, 16, 32}, {2, 34, 16, 32}, 1}};
    for (int64_t tile : {kInvocation, kWorkgroup})
        for (int64_t n : edgeSizes(tile)) {
            cases.push_back({{3, n}, {3, 5}, 1});
            cases.push_back({{2, 6}, {2, n}, 1});
        }
    for (const auto& c : cases)
        checkOp(op, {.inputs = {{"a", random(c.a, 1)}, {"b", random(c.b, 2)}},
                     .attributes = {{"axis", c.axis}},
                     .reference = [&](const Values& v) -> Values {
                         const Value &a = v.at("a"), &b = v.at("b");
                         Value y{a.shape, {}};
                         size_t axis = size_t(c.axis), outer = 1;
                         y.shape[axis] += b.shape[axis];
                         for (size_t d = 0; d < axis; ++d) outer *= size_t(a.shape[d]);
                         size_t na = a.data.size() / outer, nb = b.data.size() / outer;
                         for (size_t o = 0; o < outer; ++o) {
                             auto add = [&](const Value& from, size_t n) {
                                 for (size_t i = 0; i < n; ++i)
                                     y.data.push_back(from.data[o * n + i]);
                             };
                             add(a, na);
                             add(b, nb);
                         }
                         if (relu)
                             for (double& value : y.data) value = std::max(value, 0.0);
                         return {{"y", y}};
                     }});
}

TEST(Elementwise, Concat) { checkConcat("concat", false); }
TEST(Elementwise, ConcatRelu) { checkConcat("concat_relu", true); }

TEST(Elementwise, Dropout) {
    for (const Shape& shape : shapes())
        checkOp("dropout", {.inputs = {{"x", random(shape)}},
                            .attributes = {{"rate", 0.5}, {"stream", 3}},
                            .reference = [](const Values& v) -> Values {
                                Value y = v.at("x");
                                for (size_t i = 0; i < y.data.size(); ++i)
                                    y.data[i] *=
                                        randomBits(0, 0, 3, uint32_t(i)) < 0x80000000u ? 0 : 2;
                                return {{"y", y}};
                            }});
}

TEST(Elementwise, DropoutFollowsSeedStepAndStream) {
    constexpr int64_t kCount = 20000;
    Graph graph(testDevice());
    Tensor x = graph.input({kCount});
    Tensor one = dropout(graph, x, 0.3f, 1), other = dropout(graph, x, 0.3f, 2);
    graph.output(one);
    graph.output(other);
    graph.compile();
    graph.write(x, std::vector<float>(kCount, 0.7f));
    auto run = [&](uint32_t seed, uint32_t step) {
        graph.setStep({.step = step, .seed = seed});
        graph.run();
        return graph.read(one);
    };
    std::vector<float> first = run(1, 1);
    int64_t kept = 0;
    for (float v : first) {
        EXPECT_TRUE(v == 0 || std::abs(v - 1.0f) < 1e-6f) << v;
        kept += v != 0;
    }
    EXPECT_NEAR(static_cast<double>(kept) / kCount, 0.7, 0.015);  // over four standard deviations
    auto agreement = [&](const std::vector<float>& values) {
        int64_t same = 0;
        for (size_t i = 0; i < values.size(); ++i) same += values[i] == first[i];
        return static_cast<double>(same) / kCount;
    };
    // Independent masks agree where both keep or both drop: 0.7² + 0.3².
    EXPECT_NEAR(agreement(graph.read(other)), 0.58, 0.02);
    EXPECT_NEAR(agreement(run(1, 2)), 0.58, 0.02);
    EXPECT_NEAR(agreement(run(2, 1)), 0.58, 0.02);
    EXPECT_EQ(run(1, 1), first);
}

TEST(Elementwise, Refusals) {
    auto run = [](const char* op, Shape a, Shape b, std::map<std::string, double> attributes) {
        Npz in;
        in.set("a", Array::f32(a, std::vector<float>(size_t(elementCount(a)))));
        in.set("b", Array::f32(b, std::vector<float>(size_t(elementCount(b)))));
        for (auto& [name, value] : attributes) in.set("attr_" + name, Array::scalarF64(value));
        Op::find(op)->run(testDevice(), in, {});
    };
    expectInputError(
        [&] {
            run("add", {2, 3}, {3, 2}, {});
        },
        "b: expected the shape of a [2,3], found [3,2]");
    expectInputError([&] { run("concat", {2, 3}, {3, 3}, {}); }, "outside axis 1, found [3,3]");
    expectInputError([&] { run("concat", {2, 3}, {2, 3}, {{"axis", 2}}); }, "2 is no axis");
    Npz in;
    in.set("x", Array::f32({1}, std::vector<float>{1}));
    in.set("attr_rate", Array::scalarF64(1));
    expectInputError([&] { Op::find("dropout")->run(testDevice(), in, {}); }, "found 1");
}

}  // namespace
}  // namespace doppel
