#include "nn/ops/linalg.h"

#include "linalg/params.h"
#include "nn/core/tuning.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

Values matmulReference(const Values& v) {
    const Value &a = v.at("a"), &b = v.at("b");
    bool ta = v.at("trans_a").data[0] != 0, tb = v.at("trans_b").data[0] != 0;
    size_t B = size_t(a.shape[0]), M = size_t(a.shape[ta ? 2 : 1]), K = size_t(a.shape[ta ? 1 : 2]);
    size_t N = size_t(b.shape[tb ? 1 : 2]);
    Value c{{int64_t(B), int64_t(M), int64_t(N)}, std::vector<double>(B * M * N)};
    for (size_t p = 0; p < B; ++p)
        for (size_t i = 0; i < M; ++i)
            for (size_t j = 0; j < N; ++j)
                for (size_t k = 0; k < K; ++k)
                    c.data[(p * M + i) * N + j] +=
                        a.data[p * M * K + (ta ? k * M + i : i * K + k)] *
                        b.data[p * K * N + (tb ? j * K + k : k * N + j)];
    return {{"c", c}};
}

void checkMatmul(int64_t batch, int64_t m, int64_t n, int64_t k, bool transA, bool transB,
                 Precision precision = Precision::Single) {
    SCOPED_TRACE(fmt::format("{} x {}x{}x{} trans {}{}", batch, m, n, k, transA, transB));
    const bool mixed = precision == Precision::Mixed;
    checkOp("matmul",
            {.inputs = {{"a", random(transA ? Shape{batch, k, m} : Shape{batch, m, k}, 1)},
                        {"b", random(transB ? Shape{batch, n, k} : Shape{batch, k, n}, 2)}},
             .attributes = {{"trans_a", transA}, {"trans_b", transB}},
             .reference = matmulReference,
             .forwardTolerance = mixed ? 1e-3 : 2e-5,
             .gradientTolerance = mixed ? 4e-3 : 1e-3,
             .directionTolerance = mixed ? 4e-3 : 2e-5,
             .precision = precision});
}

// Both matrices as they are and transposed.
void checkMatmul(int64_t batch, int64_t m, int64_t n, int64_t k,
                 Precision precision = Precision::Single) {
    for (bool transA : {false, true})
        for (bool transB : {false, true}) checkMatmul(batch, m, n, k, transA, transB, precision);
}

TEST(Linalg, MatmulOdd) { checkMatmul(1, 13, 31, 7); }
TEST(Linalg, MatmulEven) { checkMatmul(1, 34, 66, 18); }
TEST(Linalg, MatmulBatch) { checkMatmul(3, 8, 10, 6); }
TEST(Linalg, MatmulOne) { checkMatmul(1, 1, 1, 1); }
TEST(Linalg, MatmulPair) { checkMatmul(2, 2, 2, 2); }
TEST(Linalg, MatmulPrime) { checkMatmul(1, 127, 3, 131); }

// The edges of a tile's rows and columns and of what a loop over k takes at once; the gradients'
// products have them along the other axes. Transpositions take turns: each that a device sees first
// is a kernel to compile.
TEST(Linalg, MatmulTileEdges) {
    const int64_t many = 1000, rows = gemmPanelRows(testDevice(), many);
    const int64_t columns = gemmPanelWidth(testDevice(), many);
    int turn = 0;
    auto check = [&](int64_t m, int64_t n, int64_t k) {
        checkMatmul(1, m, n, k, turn % 2 != 0, turn / 2 % 2 != 0);
        ++turn;
    };
    for (int64_t m : edgeSizes(rows)) check(m, 34, 18);
    for (int64_t n : edgeSizes(columns)) check(13, n, 10);
    for (int64_t k : edgeSizes(kGemmUnroll)) check(14, 31, k);
}

// Large enough to be packed into panels.
TEST(Linalg, MatmulPanels) {
    checkMatmul(2, 66, 258, 10);
    checkMatmul(1, 65, 67, 5);
    checkMatmul(1, 516, 14, 11);  // two steps of B in a texel
}
// Few results, long sums: cut into parts.
TEST(Linalg, MatmulLong) { checkMatmul(2, 5, 6, 4099); }

// A few columns behind the last full tile are made by kernels of their own on a CPU: rows of A as
// they lie, or, transposed, in parts.
TEST(Linalg, MatmulNarrow) {
    checkMatmul(1, 260, 36, 20);
    checkMatmul(1, 264, 4, 8);
    checkMatmul(1, 68, 3, 1036);
    checkMatmul(1, 64, 36, 24);
}

// The edges of the longest sum that one part of a product makes.
TEST(Linalg, MatmulPartEdges) {
    for (int64_t k : edgeSizes(gemmTuning(testDevice()).shortestPart))
        checkMatmul(1, 3, 5, k, true, false);
}

// Tiles that reach over the matrices' ends, whole ones, several parts, batches.
TEST(Linalg, MatmulMixed) {
    for (auto [batch, m, n, k] : {std::array{1, 1, 1, 1},
                                  {2, 13, 31, 7},
                                  {1, 66, 130, 70},
                                  {2, 128, 128, 64},
                                  {2, 5, 6, 4099}})
        checkMatmul(batch, m, n, k, Precision::Mixed);
}

// a [m, k], b [k, n], upstream [m, n] -> c and the gradients, with mixed precision.
Npz mixedProduct(const Value& a, const Value& b, const Value& upstream) {
    Npz in;
    auto batch = [](const Value& v) { return Array::f64({1, v.shape[0], v.shape[1]}, v.data); };
    in.set("a", batch(a));
    in.set("b", batch(b));
    in.set("grad_c", batch(upstream));
    return Op::find("matmul")->run(testDevice(Precision::Mixed), in, {});
}

TEST(Linalg, MixedPrecisionRoundsTheInputsAlone) {
    // What halves hold exactly comes out as exact as sums of single precision are; what they do not
    // hold is rounded: 2049 has twelve digits.
    Value a = indices({40, 96}, std::vector<int>(40 * 96, 3)), b = indices({96, 24}, {});
    for (int i = 0; i < 96 * 24; ++i) b.data.push_back(i % 2048);
    Npz got = mixedProduct(a, b, random({40, 24}));
    for (int64_t column = 0; column < 24; ++column) {
        double sum = 0;
        for (size_t k = 0; k < 96; ++k) sum += 3 * b.data[k * 24 + size_t(column)];
        EXPECT_EQ(got.at("c").toF64()[size_t(column)], sum);
    }
    double rounded = mixedProduct(indices({1, 1}, {2049}), indices({1, 1}, {1}), random({1, 1}))
                         .at("c")
                         .toF64()[0];
    EXPECT_TRUE(rounded == 2048 || rounded == 2050) << rounded;
}

TEST(Linalg, MixedPrecisionKeepsTinyGradientsAndShowsWhatIsNotFinite) {
    Value a = random({33, 20}, 1), b = random({20, 17}, 2), upstream = random({33, 17}, 3);
    Npz plain = mixedProduct(a, b, upstream);
    for (double factor : {1e-30, 1e-9, 1e9}) {
        Value scaled = upstream;
        for (double& v : scaled.data) v *= factor;
        Npz got = mixedProduct(a, b, scaled);
        for (const char* name : {"grad_a", "grad_b"}) {
            std::vector<double> back = got.at(name).toF64();
            for (double& v : back) v /= factor;
            EXPECT_LE(relativeError(back, plain.at(name).toF64(), 1e-6), 1e-3) << name << factor;
        }
    }
    // Beyond a half's end: the largest that there is. NaN is not hidden.
    a.data.assign(a.data.size(), 0);
    a.data[0] = 1e30;
    b.data.assign(b.data.size(), 1);
    EXPECT_EQ(mixedProduct(a, b, upstream).at("c").toF64()[0], 65504);
    a.data[0] = NAN;
    EXPECT_TRUE(std::isnan(mixedProduct(a, b, upstream).at("c").toF64()[0]));
    upstream.data[5] = INFINITY;
    a.data[0] = 1;
    EXPECT_FALSE(std::isfinite(mixedProduct(a, b, upstream).at("grad_a").toF64()[5 / 17]));
}

TEST(Linalg, ProductAddsToWhatIsThere) {
    // C[5,6] within rows of 9, twice: C = A B + bias per row, then C += A B. K = 3000 is split.
    for (int64_t k : {3, 3000}) {
        int64_t m = 5, n = 6, ldc = 9;
        Value a = random({m, k}, 1), b = random({k, n}, 2), bias = random({m}, 3);
        auto floats = [](const Value& v) {
            return std::vector<float>(v.data.begin(), v.data.end());
        };
        Graph graph(testDevice());
        Tensor A = graph.input(a.shape), B = graph.input(b.shape), bv = graph.input(bias.shape);
        Tensor C = graph.temporary({m, ldc});
        graph.beginOp("test");
        graph.fill(C);
        Gemm g{.m = m, .n = n, .k = k, .ldc = ldc, .bias = bv, .biasPerRow = true};
        gemm(graph, A, B, C, g);
        g.accumulate = true;
        g.bias = {};
        gemm(graph, A, B, C, g);
        graph.output(C);
        graph.compile({.poison = true});
        graph.write(A, floats(a));
        graph.write(B, floats(b));
        graph.write(bv, floats(bias));
        graph.run();
        std::vector<float> got = graph.read(C);
        std::vector<double> values(got.begin(), got.end()), expected(values.size());
        Values reference = matmulReference({{"a", {{1, m, k}, a.data}},
                                            {"b", {{1, k, n}, b.data}},
                                            {"trans_a", {{}, {0}}},
                                            {"trans_b", {{}, {0}}}});
        for (size_t i = 0; i < size_t(m); ++i)
            for (size_t j = 0; j < size_t(n); ++j)
                expected[i * size_t(ldc) + j] =
                    2 * reference.at("c").data[i * size_t(n) + j] + bias.data[i];
        EXPECT_LE(relativeError(values, expected, 1e-6), 2e-5);
        graph.run();
        EXPECT_EQ(graph.read(C), got) << "the same bits every run";
    }
}

TEST(Linalg, Linear) {
    for (auto [v, i, o] : {std::array{1, 1, 1},
                           {13, 7, 3},
                           {127, 131, 13},
                           {50, 16, 32},
                           {300, 36, 3},
                           // Narrow products take a few rows at once, and as many as four columns.
                           {255, 8, 4},
                           {256, 8, 4},
                           {257, 8, 4},
                           {261, 8, 1},
                           {256, 12, 2},
                           {256, 12, 5}})
        for (bool withBias : {true, false}) {
            OpCase c{.inputs = {{"x", random({v, i}, 1)},
                                {"weight", random({o, i}, 2)},
                                {"bias", random({o}, 3)}},
                     .reference = [](const Values& in) -> Values {
                         const Value &x = in.at("x"), &w = in.at("weight");
                         size_t V = size_t(x.shape[0]), I = size_t(x.shape[1]);
                         size_t O = size_t(w.shape[0]);
                         Value y{{x.shape[0], w.shape[0]}, std::vector<double>(V * O)};
                         for (size_t r = 0; r < V; ++r)
                             for (size_t q = 0; q < O; ++q) {
                                 double sum = in.contains("bias") ? in.at("bias").data[q] : 0;
                                 for (size_t k = 0; k < I; ++k)
                                     sum += x.data[r * I + k] * w.data[q * I + k];
                                 y.data[r * O + q] = sum;
                             }
                         return {{"y", y}};
                     }};
            if (!withBias) c.inputs.erase("bias");
            checkOp("linear", c);
        }
}

TEST(Linalg, RefusesMatricesThatDoNotFit) {
    Npz in;
    in.set("a", Array::f32({1, 2, 3}, std::vector<float>(6)));
    in.set("b", Array::f32({1, 2, 3}, std::vector<float>(6)));
    expectInputError([&] { Op::find("matmul")->run(testDevice(), in, {}); },
                     "expected matrices that fit, found [1,2,3] and [1,2,3]");
}

}  // namespace
}  // namespace doppel
