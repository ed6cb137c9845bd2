#include "nn/ops/optim.h"

#include <cmath>

#include "common/blocks.h"
#include "nn/ops/elementwise.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

// One element, one update.
void update(double& x, double& m, double& v, double g, int step, const Values& o) {
    auto get = [&](const char* name) { return o.at(name).data[0]; };
    double rate = get("lr"), b1 = get("beta1"), b2 = get("beta2");
    x *= 1 - rate * get("weight_decay");
    m = b1 * m + (1 - b1) * g;
    v = b2 * v + (1 - b2) * g * g;
    double mHat = m / (1 - std::pow(b1, step)), vHat = v / (1 - std::pow(b2, step));
    x -= rate * mHat / (std::sqrt(vHat) + get("eps"));
}

const std::map<std::string, double> kOptions = {
    {"lr", 0.01}, {"beta1", 0.5}, {"beta2", 0.99}, {"eps", 1e-8}, {"weight_decay", 0.1}};

TEST(Optim, AdamW) {
    // The edges of an invocation's pairs and of a workgroup; wholes of blocks, and one more.
    constexpr int64_t kInvocation = 2 * kPairsEach, kBlocks = 64 * kBlocksEach * kBlockElements;
    std::vector<std::pair<int64_t, int64_t>> cases{
        {1, 1}, {13, 3}, {1270, 4}, {20481, 2}, {kBlocks, 1}, {kBlocks + 1, 1}, {kBlocks - 1, 1}};
    for (int64_t tile : {kInvocation, 64 * kInvocation})
        for (int64_t n : edgeSizes(tile)) cases.push_back({n, 2});
    for (auto [n, steps] : cases)
        checkOp("adamw", {.inputs = {{"param", random({n}, 1)}, {"grad", random({steps, n}, 2)}},
                          .attributes = kOptions,
                          .reference = [](const Values& in) -> Values {
                              Value x = in.at("param");
                              size_t size = x.data.size();
                              std::vector<double> m(size), v(size);
                              const Value& g = in.at("grad");
                              for (size_t s = 0; s < size_t(g.shape[0]); ++s)
                                  for (size_t i = 0; i < size; ++i)
                                      update(x.data[i], m[i], v[i], g.data[s * size + i],
                                             int(s + 1), in);
                              return {{"param_out", x}};
                          }});
}

TEST(Optim, AdamWRowTouchesOneRow) {
    for (double row : {0, 2}) {
        std::map<std::string, double> attributes = kOptions;
        attributes["row"] = row;
        attributes["updates"] = 5;
        checkOp("adamw_row",
                {.inputs = {{"table", random({3, 13}, 1)},
                            {"grad", random({13}, 2)},
                            {"moment1", random({3, 13}, 3)},
                            {"moment2", uniform({3, 13}, 0, 1, 4)}},
                 .attributes = attributes,
                 .reference = [&](const Values& in) -> Values {
                     Value x = in.at("table"), m = in.at("moment1"), v = in.at("moment2");
                     for (size_t i = 0; i < 13; ++i) {
                         size_t at = size_t(row) * 13 + i;
                         update(x.data[at], m.data[at], v.data[at], in.at("grad").data[i], 5, in);
                     }
                     return {{"table_out", x}, {"moment1_out", m}, {"moment2_out", v}};
                 }});
    }
}

// One step from rest: m = (1 - b1) f g, v = (1 - b2) max |f g|^2, and the preconditioner f once
// more.
TEST(Optim, UniformAdamKeepsDirections) {
    for (int64_t rows : {1, 7, 64, 2050})
        checkOp("uniform_adam",
                {.inputs = {{"param", random({rows, 3}, 1)}, {"grad", random({1, rows, 3}, 2)}},
                 .attributes = {{"lr", .01}, {"factor", .5}, {"beta1", .9}, {"beta2", .99}},
                 .reference = [](const Values& in) -> Values {
                     Value x = in.at("param");
                     const std::vector<double>& g = in.at("grad").data;
                     double most = 0;
                     for (size_t i = 0; i < g.size(); i += 3)
                         most = std::max(most,
                                         g[i] * g[i] + g[i + 1] * g[i + 1] + g[i + 2] * g[i + 2]);
                     for (size_t i = 0; i < g.size(); ++i)
                         x.data[i] -= .01 * .5 * g[i] / std::sqrt(most);
                     return {{"param_out", x}};
                 }});
}

TEST(Optim, ClipNorm) {
    std::vector<int64_t> sizes = edgeSizes(512);  // elements of a first sum, see nn/ops/optim.cpp
    sizes.insert(sizes.end(), {13, 5000, 64 * 512, 64 * 512 + 1});
    for (int64_t n : sizes)
        for (double maxNorm : {0.5, 1000.0})
            checkOp("clip_norm", {.inputs = {{"grad", random({n})}},
                                  .attributes = {{"max_norm", maxNorm}},
                                  .reference = [&](const Values& in) -> Values {
                                      Value g = in.at("grad");
                                      double squares = 0;
                                      for (double x : g.data) squares += x * x;
                                      double norm = std::sqrt(squares);
                                      for (double& x : g.data)
                                          x *= std::min(1.0, maxNorm / (norm + 1e-6));
                                      return {{"grad_out", g}, {"norm", {{}, {norm}}}};
                                  }});
}

TEST(Optim, StepsOnAllParametersTogether) {
    // Two parameters of odd sizes, loss gradients from outside, clipped together, two steps.
    Parameters parameters;
    std::vector<float> a0{0.5f, -1, 2}, b0{1.5f};
    parameters.add("a", {3}, a0);
    parameters.add("b", {1}, b0);
    parameters.allocate(testDevice());
    Graph graph(testDevice());
    Tensor ga = graph.input({3}), gb = graph.input({1});
    Tensor a = graph.parameter(parameters, "a"), b = graph.parameter(parameters, "b");
    graph.beginOp("gradients");
    graph.copy(ga, graph.gradientTarget(a));
    graph.copy(gb, graph.gradientTarget(b));
    Tensor norm = clipGradientNorm(graph, parameters, 2);
    AdamWOptions options{.rateScale = 0.5f};
    adamwStep(graph, parameters, options);
    graph.output(norm);
    graph.compile({.poison = true});
    std::vector<float> gradientA{3, 0, -4}, gradientB{12};  // of length 13
    graph.write(ga, gradientA);
    graph.write(gb, gradientB);

    Values o = {{"lr", {{}, {0.05}}},
                {"beta1", {{}, {0.5}}},
                {"beta2", {{}, {0.999}}},
                {"eps", {{}, {1e-8}}},
                {"weight_decay", {{}, {0.01}}}};
    std::vector<double> x{0.5, -1, 2, 1.5}, m(4), v(4), g{3, 0, -4, 12};
    for (int step = 1; step <= 2; ++step) {
        graph.setStep(adamwStepParams(static_cast<uint32_t>(step), 0.1f, options));
        graph.run();
        EXPECT_NEAR(graph.readScalar(norm), 13, 1e-5);
        for (size_t i = 0; i < 4; ++i) update(x[i], m[i], v[i], g[i] * 2 / (13 + 1e-6), step, o);
    }
    std::vector<float> a1 = parameters.read(parameters.entries()[0]);
    std::vector<float> b1 = parameters.read(parameters.entries()[1]);
    for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(a1[i], x[i], 1e-6);
    EXPECT_NEAR(b1[0], x[3], 1e-6);
}

// Gradients that come together are added up by pairs of elements, so that anything may lie behind a
// tensor's last one; neither the norm nor the parameters know of it.
TEST(Optim, WhatLiesBetweenTensorsCountsForNothing) {
    Parameters parameters;
    std::vector<float> start{1, 1, 1}, four{4, 0, 0};
    parameters.add("a", {3}, start);
    parameters.add("b", {1}, {5});
    parameters.allocate(testDevice());
    Graph graph(testDevice());
    Tensor a = graph.parameter(parameters, "a");
    Tensor upstream = graph.constant(std::span<const float>(four), {3});
    graph.beginOp("twice");
    Tensor once = scaleShift(graph, a, 1, 0), again = scaleShift(graph, a, -.25f, 0);
    graph.backward({{once, upstream}, {again, upstream}});
    Tensor norm = clipGradientNorm(graph, parameters, 100);
    adamwStep(graph, parameters);
    graph.output(norm);
    graph.compile({.reuseMemory = false, .poison = true});
    graph.setStep(adamwStepParams(1, 0.1f));
    graph.run();
    EXPECT_NEAR(graph.readScalar(norm), 3, 1e-6);
    Graph after(testDevice());
    Tensor all = after.attach(parameters.section(Parameters::kValues),
                              {static_cast<int64_t>(parameters.elements())});
    Tensor copied = after.temporary(all.shape);
    after.beginOp("copy");
    after.copy(all, copied);
    after.output(copied);
    after.compile();
    after.run();
    std::vector<float> values = after.read(copied);
    for (size_t i = 3; i < values.size(); ++i)
        if (i * 4 != parameters.find("b")->offset) {
            EXPECT_EQ(values[i], 0) << i;
        }
}

TEST(Optim, Refusals) {
    Npz in;
    for (const char* name : {"table", "moment1", "moment2"})
        in.set(name, Array::f32({2, 1}, std::vector<float>(2)));
    in.set("grad", Array::f32({1}, std::vector<float>(1)));
    in.set("attr_lr", Array::scalarF64(0.1));
    in.set("attr_row", Array::scalarF64(2));
    in.set("attr_updates", Array::scalarF64(1));
    expectInputError([&] { Op::find("adamw_row")->run(testDevice(), in, {}); },
                     "attr_row: the table has 2 rows, found 2");
    in.set("attr_row", Array::scalarF64(1));
    in.set("attr_updates", Array::scalarF64(0));
    expectInputError([&] { Op::find("adamw_row")->run(testDevice(), in, {}); }, "found 0");
}

}  // namespace
}  // namespace doppel
