#include <algorithm>
#include <cmath>

#include "nn/ops/elementwise.h"
#include "nn/ops/fit.h"
#include "nn/steps/losses.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

TEST(Fit, SelectRow) {
    std::vector<std::pair<int64_t, int>> cases{{13, -3}, {13, 0}, {13, 1}, {13, 9}};
    for (int64_t columns : edgeSizes(64)) cases.emplace_back(columns, 1);  // of a workgroup
    for (auto [columns, offset] : cases)
        checkOp("select_row",
                {.inputs = {{"table", random({5, columns})}},
                 .integers = {{"index", indices({3}, {7, 2, 4})}},
                 .attributes = {{"word", 1}, {"offset", offset}},
                 .reference = [=, columns = columns, offset = offset](const Values& v) -> Values {
                     int row = std::clamp(2 + offset, 0, 4);
                     auto begin = v.at("table").data.begin() + row * columns;
                     return {{"row", {{columns}, {begin, begin + columns}}}};
                 }});
    expectInputError(
        [] {
            Npz in;
            in.set("table", Array::f32({1, 1}, std::vector<float>{1}));
            in.set("index", Array::i32({1}, std::vector<int32_t>{0}));
            in.set("attr_word", Array::scalarF32(1));
            Op::find("select_row")->run(testDevice(), in, {});
        },
        "attr_word");
}

TEST(Fit, PoseCorrection) {
    checkOp("pose_correction",
            {.inputs = {{"start", random({75}, 1)}, {"correction", random({75}, 2)}},
             .attributes = {{"trans_scale", 0.5}},
             .reference = [](const Values& v) -> Values {
                 Value theta{{72}, {}}, trans{{3}, {}};
                 for (size_t i = 0; i < 75; ++i) {
                     double c = v.at("correction").data[i], s = v.at("start").data[i];
                     (i < 72 ? theta : trans).data.push_back(s + (i < 72 ? c : 0.5 * c));
                 }
                 return {{"theta", theta}, {"trans", trans}};
             }});
}

TEST(Fit, PosePrior) {
    checkOp("pose_prior",
            {.inputs = {{"correction", random({75}, 1)},
                        {"before", random({75}, 2)},
                        {"after", random({75}, 3)},
                        {"start_bend", random({75}, 5)},
                        {"joint_weight", uniform({24}, 0.5, 2)},
                        {"beta", random({10}, 4)}},
             .attributes = {{"pose", 0.3}, {"trans", 0.7}, {"smooth", 0.2}, {"shape", 0.05}},
             .reference = [](const Values& v) -> Values {
                 auto at = [&](const char* name, size_t i) { return v.at(name).data[i]; };
                 double sum = 0;
                 for (size_t i = 0; i < 75; ++i) {
                     double c = at("correction", i);
                     double stay =
                         i < 72 ? at("pose", 0) * at("joint_weight", i / 3) : at("trans", 0);
                     double bend = c - (at("before", i) + at("after", i)) / 2 + at("start_bend", i);
                     sum += stay * c * c + at("smooth", 0) * bend * bend;
                 }
                 for (size_t i = 0; i < 10; ++i)
                     sum += at("shape", 0) * at("beta", i) * at("beta", i);
                 return {{"loss", {{}, {sum}}}};
             }});
}

// Five poses, of which the middle one turns as no body turns from one picture to the next.
TEST(Fit, BendsOfAStart) {
    std::vector<float> poses(5 * 75);
    for (size_t f = 0; f < 5; ++f) {
        poses[75 * f + 1] = f == 2 ? 2.f : 0.f;
        poses[75 * f + 30] = float(f * f) * .01f;
        poses[75 * f + 74] = float(f * f) * .01f;
    }
    const std::vector<float> bends = startBends(poses, .4f);
    for (size_t f = 0; f < 5; ++f) {
        EXPECT_EQ(bends[75 * f + 30], 0) << f;  // at ends, and beside and in the jump
        EXPECT_EQ(bends[75 * f + 74], 0) << f;
    }
    for (size_t f = 0; f < 5; ++f) poses[75 * f + 1] = 0;
    const std::vector<float> even = startBends(poses, .4f);
    for (size_t f = 0; f < 5; ++f) {
        const bool within = f > 0 && f < 4;
        EXPECT_NEAR(even[75 * f + 30], within ? -.01 : 0, 1e-6) << f;
        EXPECT_NEAR(even[75 * f + 74], within ? -.025 : 0, 1e-6) << f;
    }
    EXPECT_TRUE(startBends({}, .4f).empty());
    EXPECT_EQ(startBends(std::vector<float>(75, 1), .4f), std::vector<float>(75));
}

TEST(Fit, PoseLikelihood) {
    Value angles = random({72, 4}, 2);
    for (size_t i = 0; i < 72; ++i) {
        angles.data[4 * i + 1] = 1 + std::abs(angles.data[4 * i + 1]);
        // Some inside, some beyond either limit; none at a limit's own place.
        angles.data[4 * i + 2] = -.5;
        angles.data[4 * i + 3] = .4;
    }
    checkOp("pose_likelihood",
            {.inputs = {{"theta", random({72}, 1)}, {"angles", angles}},
             .attributes = {{"likely", .3}, {"limits", .7}},
             .reference = [](const Values& v) -> Values {
                 const auto& theta = v.at("theta").data;
                 const auto& a = v.at("angles").data;
                 double sum = 0;
                 for (size_t joint = 0; joint < 24; ++joint) {
                     double squares = 0;
                     for (size_t i = 3 * joint; i < 3 * joint + 3; ++i) {
                         squares += std::pow((theta[i] - a[4 * i]) * a[4 * i + 1], 2);
                         sum += .7 * std::pow(std::max({theta[i] - a[4 * i + 3],
                                                        a[4 * i + 2] - theta[i], 0.}),
                                              2);
                     }
                     sum += .3 * std::log(1 + squares);
                 }
                 return {{"loss", {{}, {sum}}}};
             }});
}

TEST(Fit, BalanceLoss) {
    checkOp("balance_loss",
            {.inputs = {{"joints", random({24, 3}, 1)},
                        {"shares", random({24}, 2)},
                        {"up", random({2}, 3)}},
             .attributes = {{"deviation", .6}, {"level", .3}},
             .reference = [](const Values& v) -> Values {
                 std::array<double, 3> q{};
                 for (size_t i = 0; i < 72; ++i)
                     q[i % 3] += v.at("shares").data[i / 3] * v.at("joints").data[i];
                 const double a = v.at("up").data[0], b = v.at("up").data[1];
                 const double along = (a * q[0] - q[1] + b * q[2]) / std::sqrt(a * a + 1 + b * b);
                 const double aside = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] - along * along;
                 return {{"loss", {{}, {std::log(1 + aside / .36) + .3 * (a * a + b * b)}}}};
             }});
}

TEST(Fit, WeightedSum) {
    auto reference = [](const Values& v) -> Values {
        double sum = 0;
        for (std::string name : {"a", "b", "c", "d"})
            if (v.contains(name)) sum += v.at("weight_" + name).data[0] * v.at(name).data[0];
        return {{"loss", {{}, {sum}}}};
    };
    checkOp("weighted_sum", {.inputs = {{"a", random({}, 1)}},
                             .attributes = {{"weight_a", 3}},
                             .reference = reference});
    checkOp(
        "weighted_sum",
        {.inputs = {{"a", random({}, 1)},
                    {"b", random({}, 2)},
                    {"c", random({}, 3)},
                    {"d", random({}, 4)}},
         .attributes = {{"weight_a", 1}, {"weight_b", -2}, {"weight_c", 0.5}, {"weight_d", 100}},
         .reference = reference});
}

// ---- loss terms ---------------------------------------------------------------------------------

TEST(Losses, AnyNumberOfTermsIsSummedAndAveragedOverAnyBatch) {
    for (size_t batch : {1, 2, 3, 7})
        for (size_t count : {1, 3, 4, 5, 9}) {
            Graph graph(testDevice());
            Losses losses(graph);
            std::vector<Tensor> inputs;
            std::vector<double> weights;
            for (size_t k = 0; k < count; ++k) weights.push_back(0.5 + double(k) * double(k));
            for (size_t n = 0; n < batch; ++n)
                for (size_t k = 0; k < count; ++k) {
                    inputs.push_back(graph.variable({}));
                    losses.term(fmt::format("term{}", k), weights[k],
                                scaleShift(graph, inputs.back(), 1, 0));
                }
            graph.backward(losses.sum());
            for (const Tensor& input : inputs) graph.output(graph.gradient(input));
            graph.compile({.poison = true});
            std::vector<double> means(count);
            for (size_t i = 0; i < inputs.size(); ++i) {
                double value = std::sin(double(i) + 1);
                means[i % count] += value / double(batch);
                graph.write(inputs[i], std::vector<float>{float(value)});
            }
            graph.run();

            double sum = 0;
            for (size_t k = 0; k < count; ++k) sum += weights[k] * means[k];
            std::vector<double> values = losses.read();
            ASSERT_EQ(losses.names().size(), count + 1);
            ASSERT_EQ(values.size(), count + 1);
            EXPECT_EQ(losses.names()[0], "loss");
            EXPECT_NEAR(values[0], sum, 1e-5 * weights.back());
            for (size_t k = 0; k < count; ++k) {
                EXPECT_EQ(losses.names()[k + 1], fmt::format("term{}", k));
                EXPECT_NEAR(values[k + 1], means[k], 1e-6);
            }
            // To the bit: the parts' gradients are what training hands on.
            for (size_t i = 0; i < inputs.size(); ++i)
                EXPECT_EQ(graph.readScalar(graph.gradient(inputs[i])),
                          float(weights[i % count]) * (1.0f / float(batch)))
                    << i << " of " << count << " terms, batch " << batch;
        }
}

TEST(Losses, ATermOfTheWholeBatchStandsBesideOnesOfFrames) {
    Graph graph(testDevice());
    auto number = [&](float value) {
        return graph.constant(std::span<const float>(&value, 1), {});
    };
    Losses first(graph), second(graph);
    for (float value : {1.f, 2.f, 6.f}) first.term("frames", 2, number(value));
    first.term("batch", 10, number(5));
    first.sum();
    second.term("other", 3, number(7));
    second.sum();
    first.append(second);
    graph.compile();
    graph.run();
    EXPECT_EQ(first.names(), (std::vector<std::string>{"loss", "frames", "batch", "other"}));
    EXPECT_EQ(first.read(), (std::vector<double>{56, 3, 5, 7}));
    EXPECT_EQ(graph.readScalar(first.find("batch")), 5);
    EXPECT_FALSE(first.find("nothing"));
}

}  // namespace
}  // namespace doppel
