#include "nn/ops/texture.h"

#include <array>
#include <cmath>
#include <random>

#include "tests/op_test.h"

namespace doppel {
namespace {

TEST(TextureLayout, Interleave) {
    std::vector<Shape> shapes{{1, 1, 1}, {3, 13, 7}, {4, 2, 127}};
    for (int64_t tile : {8, 64})  // pixels of an invocation in pairs or quads, of a workgroup
        for (int64_t n : edgeSizes(tile)) shapes.push_back({3, 1, n});
    for (const Shape& shape : shapes)
        checkOp("interleave",
                {.inputs = {{"x", random(shape)}}, .reference = [=](const Values& v) -> Values {
                     const auto& x = v.at("x").data;
                     auto c = size_t(shape[0]), p = x.size() / c;
                     Value y{{shape[1], shape[2], shape[0]}, std::vector<double>(x.size())};
                     for (size_t i = 0; i < p; ++i)
                         for (size_t k = 0; k < c; ++k) y.data[i * c + k] = x[k * p + i];
                     return {{"y", y}};
                 }});
}

TEST(Texture, BinomialMean) {
    auto reference = [](const Values& v) -> Values {
        const Value& x = v.at("x");
        const int64_t h = x.shape[0], w = x.shape[1], channels = x.shape[2];
        Value y = x;
        for (int64_t i = 0; i < int64_t(y.data.size()); ++i) {
            const int64_t row = i / channels / w, column = i / channels % w;
            double sum = 0;
            for (int64_t v2 = -1; v2 <= 1; ++v2)
                for (int64_t u = -1; u <= 1; ++u) {
                    if (row + v2 < 0 || row + v2 >= h || column + u < 0 || column + u >= w)
                        continue;
                    sum += (v2 == 0 ? .5 : .25) * (u == 0 ? .5 : .25) *
                           x.data[size_t(i + (v2 * w + u) * channels)];
                }
            y.data[size_t(i)] = sum;
        }
        return {{"y", y}};
    };
    for (const Shape& shape :
         {Shape{1, 1, 1}, {1, 7, 3}, {9, 1, 2}, {2, 2, 3}, {13, 11, 3}, {8, 16, 4}}) {
        const Value x = random(shape);
        checkOp("binomial_mean", {.inputs = {{"x", x}}, .reference = reference});
        const std::vector<float> host = binomialMean(
            std::vector<float>(x.data.begin(), x.data.end()), shape[0], shape[1], shape[2]);
        const Value expected = reference({{"x", x}}).at("y");
        for (size_t i = 0; i < host.size(); ++i) EXPECT_NEAR(host[i], expected.data[i], 1e-6);
    }
}

// Random normals, zero at one vertex; texels in a face, on its edge, at a corner and between the
// charts.
TEST(Texture, UnderALight) {
    auto reference = [](const Values& v) -> Values {
        const Value &texture = v.at("texture"), &light = v.at("light"), &normals = v.at("normals");
        const Value &faces = v.at("faces"), &corners = v.at("texel_corners");
        Value lit = texture;
        for (size_t t = 0; t < v.at("texel_faces").data.size(); ++t) {
            const double face = v.at("texel_faces").data[t];
            std::array<double, 3> n{};
            if (face >= 0)
                for (size_t k = 0; k < 3; ++k) {
                    const double first = corners.data[2 * t], second = corners.data[2 * t + 1];
                    const double share = k == 0 ? 1 - first - second : k == 1 ? first : second;
                    const auto vertex = size_t(faces.data[3 * size_t(face) + k]);
                    for (size_t d = 0; d < 3; ++d) n[d] += share * normals.data[3 * vertex + d];
                }
            const double size = std::hypot(n[0], n[1], n[2]);
            std::array<double, 9> y{1};
            if (size > 1e-6) {
                const double a = n[0] / size, b = n[1] / size, c = n[2] / size;
                const double k1 = std::sqrt(3), k2 = std::sqrt(15);
                y = {1,
                     k1 * b,
                     k1 * c,
                     k1 * a,
                     k2 * a * b,
                     k2 * b * c,
                     std::sqrt(5) / 2 * (3 * c * c - 1),
                     k2 * a * c,
                     k2 / 2 * (a * a - b * b)};
            }
            for (size_t c = 0; c < 3; ++c) {
                double factor = 0;
                for (size_t k = 0; k < 9; ++k) factor += y[k] * light.data[3 * k + c];
                lit.data[3 * t + c] *= factor;
            }
        }
        return {{"lit", lit}};
    };
    std::mt19937 draw(7);
    for (int64_t side : {1, 5, 33, 80}) {  // 80: more texels than partial sums
        Value normals = random({5, 3}, 3);
        for (size_t v = 0; v < 5; ++v) {
            double* n = &normals.data[3 * v];
            const double size = v == 4 ? INFINITY : std::hypot(n[0], n[1], n[2]);
            for (size_t d = 0; d < 3; ++d) n[d] /= size;
        }
        std::vector<int> faces;
        Value corners{{side, side, 2}, {}};
        for (int64_t t = 0; t < side * side; ++t) {
            faces.push_back(int(draw() % 4) - 1);
            const double first = t % 7 == 0 ? 0 : double(draw() % 1000) / 2000;
            corners.data.insert(corners.data.end(), {first, t % 5 == 0 ? 1 - first : .3});
        }
        checkOp("lit_texture",
                {.inputs = {{"texture", random({side, side, 3})},
                            {"light", random({9, 3}, 2)},
                            {"normals", normals},
                            {"texel_corners", corners}},
                 .integers = {{"faces", indices({3, 3}, {0, 1, 2, 2, 1, 3, 4, 4, 4})},
                              {"texel_faces", indices({side, side}, faces)}},
                 .reference = reference});
    }
    expectInputError(
        [] {
            Op::find("lit_texture")
                ->run(testDevice(),
                      [] {
                          Npz arrays;
                          arrays.set("texture", Array::f32({1, 1, 3}, std::vector<float>(3)));
                          arrays.set("light", Array::f32({9, 3}, std::vector<float>(27)));
                          arrays.set("normals", Array::f32({3, 3}, std::vector<float>(9)));
                          arrays.set("faces", Array::i32({1, 3}, std::vector<int32_t>{0, 1, 2}));
                          arrays.set("texel_faces", Array::i32({1, 1}, std::vector<int32_t>{1}));
                          arrays.set("texel_corners", Array::f32({1, 1, 2}, std::vector<float>(2)));
                          return arrays;
                      }(),
                      {});
        },
        "texel_faces: expected numbers from -1 to 0, found 1");
}

// Shape [N,C r r,H,W] either way, and there and back again.
TEST(TextureLayout, PixelShuffle) {
    struct Case {
        Shape coarse;
        int64_t block;
    };
    for (const auto& [coarse, block] : {Case{{1, 4, 1, 1}, 2},
                                        {{2, 12, 3, 5}, 2},
                                        {{1, 9, 2, 4}, 3},
                                        {{3, 2, 7, 3}, 1},
                                        {{1, 16, 5, 13}, 4},
                                        {{1, 8, 8, 16}, 2}}) {
        const int64_t r = block, C = coarse[1] / r / r, H = coarse[2], W = coarse[3];
        const Shape fine{coarse[0], C, H * r, W * r};
        auto reference = [=](bool shuffle) {
            return [=](const Values& v) -> Values {
                Value y{shuffle ? fine : coarse, std::vector<double>(v.at("x").data.size())};
                size_t at = 0;  // in `coarse`, channel by channel
                for (int64_t n = 0; n < coarse[0]; ++n)
                    for (int64_t c = 0; c < coarse[1]; ++c)
                        for (int64_t h = 0; h < H; ++h)
                            for (int64_t w = 0; w < W; ++w, ++at) {
                                const int64_t i = c / r % r, j = c % r;
                                const auto there = static_cast<size_t>(
                                    ((n * C + c / r / r) * H * r + h * r + i) * W * r + w * r + j);
                                (shuffle ? y.data[there] : y.data[at]) =
                                    v.at("x").data[shuffle ? at : there];
                            }
                return {{"y", y}};
            };
        };
        const std::map<std::string, double> attributes{{"block", static_cast<double>(r)}};
        checkOp("pixel_shuffle", {.inputs = {{"x", random(coarse)}},
                                  .attributes = attributes,
                                  .reference = reference(true)});
        checkOp("pixel_unshuffle", {.inputs = {{"x", random(fine)}},
                                    .attributes = attributes,
                                    .reference = reference(false)});
    }
}

// Each texture of a batch hands its gradient to its own planes; one without gradient gives zeros.
TEST(TextureLayout, BatchKeepsImagesApart) {
    Graph graph(testDevice());
    Tensor x = graph.variable({2, 4, 1, 4});
    std::vector<Tensor> textures = interleave(graph, x);
    ASSERT_EQ(textures.size(), 2u);
    Tensor upstream = graph.input({1, 4, 4});
    graph.backward({{textures[1], upstream}});
    Tensor dx = graph.gradient(x);
    graph.output(dx);
    graph.compile({.poison = true});
    std::vector<float> values(16);
    for (size_t i = 0; i < 16; ++i) values[i] = static_cast<float>(i + 1);
    graph.write(upstream, values);
    graph.run();
    std::vector<float> got = graph.read<float>(dx);
    for (size_t i = 0; i < 16; ++i) {
        EXPECT_EQ(got[i], 0.0f);
        EXPECT_EQ(got[16 + i], values[i % 4 * 4 + i / 4]);
    }
}

}  // namespace
}  // namespace doppel
