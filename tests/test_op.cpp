// The op registry and its refusals. (That no op is left without a test: test_kernels.cpp.)
#include "bench/params.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

TEST(OpRegistry, RefusesWhatDoesNotFit) {
    const Op* op = Op::find("leaky_relu");
    ASSERT_NE(op, nullptr);
    EXPECT_EQ(Op::find("no_such_op"), nullptr);
    Npz in;
    expectInputError([&] { op->run(testDevice(), in, {}); }, "input x is missing");
    std::vector<float> x{1, -2, 3};
    in.set("x", Array::f32({3}, x));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "attr_slope is missing");
    in.set("attr_slope", Array::scalarF32(NAN));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "must be finite");
    in.set("attr_slope", Array::scalarF32(0.5f));
    in.set("grad_y", Array::f32({1}, std::vector<float>{1}));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "expected the shape of y [3]");
    in.set("grad_y", Array::f32({3}, std::vector<float>{1, 1, 1}));
    in.set("nonsense", Array::f32({1}, std::vector<float>{1}));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "nonsense");
}

// The kernels that doppel-bench compares ops with belong to no op: eight chains of multiply-adds
// for each number, and a copy.
TEST(Ceilings, ComputeWhatTheySay) {
    for (int64_t n : edgeSizes(64)) {
        Graph graph(testDevice());
        const CeilingParams params{static_cast<uint32_t>(n), 3};
        Tensor x = graph.input({n, 4}), chains = graph.temporary({n, 4});
        Tensor copy = graph.temporary({n, 4});
        graph.beginOp("ceilings");
        for (auto [kernel, y] :
             {std::pair("bench/ceiling.fma", chains), std::pair("bench/ceiling.copy", copy)}) {
            graph.dispatch(kernel, {{"x", x}, {"y", y}}, params, static_cast<uint64_t>(n));
            graph.output(y);
        }
        graph.compile({.poison = true});
        Value values = uniform({n, 4}, -1, 1);
        std::vector<float> given(values.data.begin(), values.data.end());
        graph.write(x, given);
        graph.run();
        std::vector<double> expected;
        for (float a : given) {
            double sum = 0;
            for (int chain = 0; chain < 8; ++chain) {
                double s = double(a) + chain;
                for (uint32_t round = 0; round < params.rounds; ++round) s = s * double(a) + 0.5;
                sum += s;
            }
            expected.push_back(sum);
        }
        std::vector<float> got = graph.read(chains);
        EXPECT_LE(relativeError({got.begin(), got.end()}, expected, 1e-6), 1e-6) << n;
        EXPECT_EQ(graph.read(copy), given) << n;
    }
}

}  // namespace
}  // namespace doppel
