// Pooling, convolution in time and the distance of features against plain double-precision loops.
#include "nn/ops/features.h"

#include <cmath>

#include "tests/op_test.h"

namespace doppel {
namespace {

size_t at(const Shape& s, int64_t a, int64_t b, int64_t c, int64_t d) {
    return size_t(((a * s[1] + b) * s[2] + c) * s[3] + d);
}

// The greatest value of windows [kt,k,k] every [st,s,s] that start at -before; outside is left out.
Value pooled(const Value& x, Shape out, int64_t kt, int64_t k, int64_t st, int64_t s,
             std::array<int64_t, 3> before) {
    Value y{out, std::vector<double>(size_t(elementCount(out)))};
    for (int64_t t = 0; t < out[0]; ++t)
        for (int64_t c = 0; c < out[1]; ++c)
            for (int64_t i = 0; i < out[2]; ++i)
                for (int64_t j = 0; j < out[3]; ++j) {
                    double most = -INFINITY;
                    for (int64_t dt = 0; dt < kt; ++dt)
                        for (int64_t di = 0; di < k; ++di)
                            for (int64_t dj = 0; dj < k; ++dj) {
                                int64_t ft = t * st + dt - before[0], fi = i * s + di - before[1],
                                        fj = j * s + dj - before[2];
                                if (ft < 0 || ft >= x.shape[0] || fi < 0 || fi >= x.shape[2] ||
                                    fj < 0 || fj >= x.shape[3])
                                    continue;
                                most = std::max(most, x.data[at(x.shape, ft, c, fi, fj)]);
                            }
                    y.data[at(out, t, c, i, j)] = most;
                }
    return y;
}

TEST(Features, MaxPool2d) {
    struct Case {
        Shape x;
        int kernel, stride, padding, ceil;
        int64_t height, width;  // of y, as PyTorch has them
    };
    const Case cases[] = {{{1, 1, 1, 1}, 1, 1, 0, 0, 1, 1},     {{2, 3, 13, 7}, 3, 2, 0, 0, 6, 3},
                          {{2, 3, 12, 8}, 3, 2, 0, 1, 6, 4},    {{1, 2, 12, 8}, 3, 2, 0, 0, 5, 3},
                          {{1, 13, 6, 127}, 2, 2, 0, 0, 3, 63}, {{1, 2, 5, 5}, 3, 2, 1, 0, 3, 3},
                          {{1, 1, 4, 4}, 2, 3, 1, 1, 2, 2},     {{1, 2, 5, 6}, 2, 2, 1, 1, 3, 4}};
    for (const Case& c : cases) {
        Shape out{c.x[0], c.x[1], c.height, c.width};
        Value x = random(c.x, 1);
        for (double& v : x.data) v -= 3;  // a zero from the border would be the greatest
        checkOp("max_pool2d", {.inputs = {{"x", x}},
                               .attributes = {{"kernel", double(c.kernel)},
                                              {"stride", c.stride},
                                              {"padding", c.padding},
                                              {"ceil", c.ceil}},
                               .reference = [&](const Values& v) -> Values {
                                   return {{"y", pooled(v.at("x"), out, 1, c.kernel, 1, c.stride,
                                                        {0, c.padding, c.padding})}};
                               }});
    }
}

// TensorFlow's "SAME": windows and what lies before the first.
std::pair<int64_t, int64_t> same(int64_t size, int64_t kernel, int64_t stride) {
    int64_t count = (size + stride - 1) / stride;
    return {count, std::max<int64_t>((count - 1) * stride + kernel - size, 0) / 2};
}

TEST(Features, MaxPool3d) {
    struct Case {
        Shape x;
        int64_t kt, k, st, s;
    };
    const Case cases[] = {{{1, 1, 1, 1}, 3, 3, 1, 1},
                          {{5, 3, 7, 6}, 1, 3, 1, 2},
                          {{4, 2, 5, 13}, 3, 3, 2, 2},
                          {{3, 13, 4, 5}, 2, 2, 2, 2},
                          {{3, 2, 7, 7}, 3, 3, 1, 1}};
    for (const Case& c : cases) {
        auto [t, bt] = same(c.x[0], c.kt, c.st);
        auto [h, bh] = same(c.x[2], c.k, c.s);
        auto [w, bw] = same(c.x[3], c.k, c.s);
        Shape out{t, c.x[1], h, w};
        std::array<int64_t, 3> before{bt, bh, bw};
        checkOp("max_pool3d",
                {.inputs = {{"x", random(c.x, 1)}},
                 .attributes = {{"kernel_t", double(c.kt)},
                                {"kernel", double(c.k)},
                                {"stride_t", double(c.st)},
                                {"stride", double(c.s)}},
                 .reference = [&](const Values& v) -> Values {
                     return {{"y", pooled(v.at("x"), out, c.kt, c.k, c.st, c.s, before)}};
                 }});
    }
}

TEST(Features, Conv3d) {
    struct Case {
        Shape x, weight;
        int64_t st, s;
        bool bias;
    };
    const Case cases[] = {{{1, 1, 1, 1}, {1, 1, 1, 1, 1}, 1, 1, true},
                          {{5, 2, 7, 6}, {3, 2, 3, 3, 3}, 1, 1, true},
                          {{6, 3, 9, 8}, {4, 3, 7, 7, 7}, 2, 2, false},
                          {{4, 13, 5, 4}, {2, 13, 1, 1, 1}, 1, 1, true},
                          {{7, 2, 6, 6}, {2, 2, 3, 1, 1}, 2, 1, false},
                          {{3, 2, 6, 127}, {2, 2, 2, 3, 3}, 2, 2, true}};
    for (const Case& c : cases) {
        int64_t O = c.weight[0], C = c.weight[1];
        auto [T, bt] = same(c.x[0], c.weight[2], c.st);
        auto [H, bh] = same(c.x[2], c.weight[3], c.s);
        auto [W, bw] = same(c.x[3], c.weight[4], c.s);
        auto reference = [&, T = T, H = H, W = W, bt = bt, bh = bh,
                          bw = bw](const Values& v) -> Values {
            const Value &x = v.at("x"), &w = v.at("weight");
            Value y{{T, O, H, W}, std::vector<double>(size_t(T * O * H * W))};
            for (int64_t t = 0; t < T; ++t)
                for (int64_t o = 0; o < O; ++o)
                    for (int64_t i = 0; i < H; ++i)
                        for (int64_t j = 0; j < W; ++j) {
                            double sum = c.bias ? v.at("bias").data[size_t(o)] : 0;
                            size_t k = size_t(o * C * c.weight[2] * c.weight[3] * c.weight[4]);
                            for (int64_t ch = 0; ch < C; ++ch)
                                for (int64_t dt = 0; dt < c.weight[2]; ++dt)
                                    for (int64_t di = 0; di < c.weight[3]; ++di)
                                        for (int64_t dj = 0; dj < c.weight[4]; ++dj, ++k) {
                                            int64_t ft = t * c.st + dt - bt, fi = i * c.s + di - bh,
                                                    fj = j * c.s + dj - bw;
                                            if (ft < 0 || ft >= x.shape[0] || fi < 0 ||
                                                fi >= x.shape[2] || fj < 0 || fj >= x.shape[3])
                                                continue;
                                            sum += w.data[k] * x.data[at(x.shape, ft, ch, fi, fj)];
                                        }
                            y.data[at(y.shape, t, o, i, j)] = sum;
                        }
            return {{"y", y}};
        };
        Values inputs{{"x", random(c.x, 1)}, {"weight", random(c.weight, 2)}};
        if (c.bias) inputs["bias"] = random({O}, 3);
        checkOp("conv3d", {.inputs = inputs,
                           .attributes = {{"stride_t", double(c.st)}, {"stride", double(c.s)}},
                           .reference = reference});
    }
}

TEST(Features, FeatureDistance) {
    std::vector<Shape> shapes{{1, 1, 1, 1}, {2, 13, 3, 5}, {1, 7, 1, 127}};
    for (int64_t pixels : edgeSizes(64)) shapes.push_back({1, 3, 1, pixels});
    for (const Shape& shape : shapes) {
        Value a = random(shape, 1), b = random(shape, 2);
        // A pixel where nothing answers: zero over zero.
        for (int64_t c = 0; c < shape[1]; ++c) a.data[at(shape, 0, c, 0, 0)] = 0;
        checkOp("feature_distance",
                {.inputs = {{"a", a}, {"b", b}, {"weight", uniform({shape[1]}, 0, 1, 3)}},
                 .reference = [&](const Values& v) -> Values {
                     const auto &p = v.at("a").data, &q = v.at("b").data;
                     Value y{{shape[0], shape[2], shape[3]}, {}};
                     for (int64_t n = 0; n < shape[0]; ++n)
                         for (int64_t i = 0; i < shape[2]; ++i)
                             for (int64_t j = 0; j < shape[3]; ++j) {
                                 double pp = 0, qq = 0, sum = 0;
                                 for (int64_t c = 0; c < shape[1]; ++c) {
                                     size_t k = at(shape, n, c, i, j);
                                     pp += p[k] * p[k], qq += q[k] * q[k];
                                 }
                                 for (int64_t c = 0; c < shape[1]; ++c) {
                                     size_t k = at(shape, n, c, i, j);
                                     sum += v.at("weight").data[size_t(c)] *
                                            std::pow(p[k] / (std::sqrt(pp) + 1e-10) -
                                                         q[k] / (std::sqrt(qq) + 1e-10),
                                                     2);
                                 }
                                 y.data.push_back(sum);
                             }
                     return {{"y", y}};
                 }});
    }
}

TEST(Features, Refusals) {
    auto run = [](const char* op, Shape shape, std::map<std::string, double> attributes) {
        Npz in;
        in.set("x", Array::f32(shape, std::vector<float>(size_t(elementCount(shape)))));
        for (const auto& [name, value] : attributes)
            in.set("attr_" + name, Array::scalarF64(value));
        Op::find(op)->run(testDevice(), in, {});
    };
    expectInputError(
        [&] {
            run("max_pool2d", {1, 1, 2, 2}, {{"kernel", 3}, {"stride", 1}});
        },
        "a window of 3 does not fit into [1,1,2,2]");
    expectInputError(
        [&] {
            run("max_pool2d", {1, 1, 2, 2}, {{"kernel", 2}, {"stride", 0}});
        },
        "attr_stride: expected 1 or more");
    expectInputError(
        [&] {
            run("max_pool2d", {1, 1, 4, 4}, {{"kernel", 2}, {"stride", 1}, {"padding", 2}});
        },
        "attr_padding: expected at most half the kernel of 2, found 2");
}

}  // namespace
}  // namespace doppel
