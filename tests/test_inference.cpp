// Ops of small networks that are run and never trained, against plain double-precision loops.
#include "nn/ops/inference/inference.h"

#include <algorithm>
#include <cmath>

#include "tests/op_test.h"

namespace doppel {
namespace {

std::vector<float> floats(const Value& value) { return {value.data.begin(), value.data.end()}; }

// What an op makes of a picture x[1,C,H,W], in memory that held NaN; and of `more`, if it takes it.
std::vector<double> run(const Value& x, const Value& more,
                        const std::function<Tensor(Graph&, Tensor, Tensor)>& op) {
    Graph graph(testDevice());
    const Tensor input = graph.input(x.shape);
    Tensor other, copy;
    if (!more.data.empty()) {
        other = graph.input(more.shape);
        copy = graph.temporary(more.shape);  // which the op may overwrite
        graph.beginOp("copy");
        graph.copy(other, copy);
    }
    const Tensor y = op(graph, input, copy);
    graph.output(y);
    graph.compile({.poison = true});
    graph.write(input, floats(x));
    if (other) graph.write(other, floats(more));
    graph.run();
    graph.run();  // what one replay leaves does not matter to the next
    const std::vector<float> values = graph.read(y);
    return {values.begin(), values.end()};
}

size_t at(const Shape& s, int64_t c, int64_t i, int64_t j) {
    return size_t((c * s[2] + i) * s[3] + j);
}

TEST(Inference, DepthwiseConvolution) {
    struct Case {
        int64_t channels, height, width, kernel, stride;
        Borders borders;
        bool relu6;
    };
    const Case cases[] = {
        {1, 1, 1, 3, 1, {1, 1, 1, 1}, false},     {3, 8, 8, 3, 1, {1, 1, 1, 1}, true},
        {13, 7, 7, 5, 1, {2, 2, 2, 2}, true},     {5, 14, 14, 3, 2, {1, 1, 1, 1}, false},
        {2, 16, 16, 5, 2, {2, 2, 2, 2}, true},    {7, 8, 12, 3, 2, {0, 1, 0, 1}, true},
        {33, 32, 128, 3, 1, {1, 1, 1, 1}, false}, {9, 64, 64, 5, 2, {2, 2, 2, 2}, false},
        {65, 36, 16, 5, 1, {2, 2, 2, 2}, true},   {4, 6, 10, 3, 1, {0, 0, 0, 0}, false},
        {2, 2, 2, 3, 1, {1, 1, 1, 1}, true}};
    for (const Case& c : cases) {
        const Value x = random({1, c.channels, c.height, c.width}, 1);
        const Value w = random({c.channels, c.kernel, c.kernel}, 2), bias = random({c.channels}, 3);
        const Borders& b = c.borders;
        const Shape out{1, c.channels, (c.height + b.top + b.bottom - c.kernel) / c.stride + 1,
                        (c.width + b.left + b.right - c.kernel) / c.stride + 1};
        std::vector<double> want(size_t(elementCount(out)));
        for (int64_t ch = 0; ch < out[1]; ++ch)
            for (int64_t i = 0; i < out[2]; ++i)
                for (int64_t j = 0; j < out[3]; ++j) {
                    double sum = bias.data[size_t(ch)];
                    for (int64_t u = 0; u < c.kernel; ++u)
                        for (int64_t v = 0; v < c.kernel; ++v) {
                            const int64_t row = i * c.stride + u - b.top;
                            const int64_t column = j * c.stride + v - b.left;
                            if (row < 0 || row >= c.height || column < 0 || column >= c.width)
                                continue;
                            sum += w.data[size_t((ch * c.kernel + u) * c.kernel + v)] *
                                   x.data[at(x.shape, ch, row, column)];
                        }
                    want[at(out, ch, i, j)] = c.relu6 ? std::clamp(sum, 0., 6.) : sum;
                }
        const std::vector<double> got = run(x, {}, [&](Graph& graph, Tensor input, Tensor) {
            const auto rows = depthwiseWeights(floats(w), floats(bias), c.channels, c.kernel);
            const Tensor weight = graph.constant(std::span<const float>(rows),
                                                 {c.channels, int64_t(rows.size()) / c.channels});
            const Tensor y = depthwiseConv2d(graph, input, weight, c.kernel, c.stride, b, c.relu6);
            EXPECT_EQ(y.shape, out);
            return y;
        });
        EXPECT_LT(relativeError(got, want, 1e-6), 1e-5) << c.channels << "×" << c.height;
    }
}

TEST(Inference, PixelConvolution) {
    struct Case {
        int64_t channels, features, height, width;
        bool relu6, residual;
    };
    const Case cases[] = {{1, 1, 1, 1, false, false},    {8, 8, 64, 64, true, true},
                          {24, 39, 13, 7, false, true},  {576, 96, 8, 8, false, true},
                          {1152, 7, 7, 7, true, false},  {192, 192, 2, 2, true, true},
                          {16, 96, 32, 32, true, false}, {17, 33, 4, 4, false, false}};
    for (const Case& c : cases) {
        const Value x = random({1, c.channels, c.height, c.width}, 1);
        const Value w = random({c.features, c.channels}, 2), bias = random({c.features}, 3);
        const Shape out{1, c.features, c.height, c.width};
        const Value more = c.residual ? random(out, 4) : Value{};
        std::vector<double> want(size_t(elementCount(out)));
        const int64_t pixels = c.height * c.width;
        for (int64_t o = 0; o < c.features; ++o)
            for (int64_t p = 0; p < pixels; ++p) {
                double sum = bias.data[size_t(o)];
                for (int64_t ch = 0; ch < c.channels; ++ch)
                    sum += w.data[size_t(o * c.channels + ch)] * x.data[size_t(ch * pixels + p)];
                if (c.residual) sum += more.data[size_t(o * pixels + p)];
                want[size_t(o * pixels + p)] = c.relu6 ? std::clamp(sum, 0., 6.) : sum;
            }
        const std::vector<double> got = run(x, more, [&](Graph& graph, Tensor input, Tensor other) {
            return pixelConv2d(graph, input, floats(w), floats(bias), c.relu6, other);
        });
        EXPECT_LT(relativeError(got, want, 1e-6), 2e-5) << c.channels << " to " << c.features;
    }
}

TEST(Inference, TwiceTheSize) {
    for (const Shape& shape : {Shape{1, 1, 1, 1}, Shape{1, 3, 7, 5}, Shape{1, 2, 4, 4},
                               Shape{1, 13, 3, 12}, Shape{1, 8, 32, 64}}) {
        for (const bool added : {false, true}) {
            const Value x = random(shape, 1);
            const Shape out{1, shape[1], 2 * shape[2], 2 * shape[3]};
            const Value more = added ? random(out, 2) : Value{};
            std::vector<double> want(size_t(elementCount(out)));
            const auto sample = [&](int64_t c, double i, double j) {
                i = std::clamp(i, 0., double(shape[2] - 1));
                j = std::clamp(j, 0., double(shape[3] - 1));
                const auto i0 = int64_t(i), j0 = int64_t(j);
                const int64_t i1 = std::min(i0 + 1, shape[2] - 1),
                              j1 = std::min(j0 + 1, shape[3] - 1);
                const double a = i - double(i0), b = j - double(j0);
                return (1 - a) * ((1 - b) * x.data[at(shape, c, i0, j0)] +
                                  b * x.data[at(shape, c, i0, j1)]) +
                       a * ((1 - b) * x.data[at(shape, c, i1, j0)] +
                            b * x.data[at(shape, c, i1, j1)]);
            };
            for (int64_t c = 0; c < out[1]; ++c)
                for (int64_t i = 0; i < out[2]; ++i)
                    for (int64_t j = 0; j < out[3]; ++j) {
                        const size_t place = at(out, c, i, j);
                        want[place] =
                            sample(c, (double(i) + .5) / 2 - .5, (double(j) + .5) / 2 - .5) +
                            (added ? more.data[place] : 0);
                    }
            const auto got = run(x, more, [](Graph& graph, Tensor input, Tensor other) {
                return upsample2(graph, input, other);
            });
            EXPECT_LT(relativeError(got, want, 1e-6), 1e-6) << toString(shape);
        }
    }
}

TEST(Inference, ChannelsToPixelsAndBehindThem) {
    const Value x = random({1, 12, 3, 5}, 1);
    const Shape out{1, 3, 6, 10};
    std::vector<double> blocks(180), last(180);
    for (int64_t c = 0; c < 12; ++c)
        for (int64_t i = 0; i < 3; ++i)
            for (int64_t j = 0; j < 5; ++j) {
                const double v = float(x.data[at(x.shape, c, i, j)]);
                blocks[at(out, c % 3, 2 * i + c / 6, 2 * j + c / 3 % 2)] = v;
                last[size_t((i * 5 + j) * 12 + c)] = v;
            }
    EXPECT_EQ(run(x, {}, [](Graph& g, Tensor input, Tensor) { return depthToSpace2(g, input); }),
              std::vector<double>(blocks.begin(), blocks.end()));
    EXPECT_EQ(run(x, {}, [](Graph& g, Tensor input, Tensor) { return channelsLast(g, input); }),
              std::vector<double>(last.begin(), last.end()));
}

}  // namespace
}  // namespace doppel
