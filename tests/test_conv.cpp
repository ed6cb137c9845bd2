#include "nn/ops/conv/conv.h"

#include <array>
#include <cmath>
#include <random>

#include "common/divide.h"
#include "conv/params.h"
#include "nn/ops/conv/algorithm.h"
#include "nn/ops/linalg.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

size_t size(const Value& v, int d) { return static_cast<size_t>(v.shape[size_t(d)]); }

// Calls f(image index, weight index, output index) for every product of a convolution of an image
// [N,C,H,W] with a kernel [O,C,kh,kw] to [N,O,H',W'].
template <typename F>
void forEachProduct(const Shape& image, const Shape& kernel, int64_t stride, int64_t padding,
                    const F& f) {
    int64_t N = image[0], C = image[1], H = image[2], W = image[3];
    int64_t O = kernel[0], kh = kernel[2], kw = kernel[3];
    int64_t OH = (H + 2 * padding - kh) / stride + 1, OW = (W + 2 * padding - kw) / stride + 1;
    for (int64_t n = 0; n < N; ++n)
        for (int64_t o = 0; o < O; ++o)
            for (int64_t oy = 0; oy < OH; ++oy)
                for (int64_t ox = 0; ox < OW; ++ox)
                    for (int64_t c = 0; c < C; ++c)
                        for (int64_t ky = 0; ky < kh; ++ky)
                            for (int64_t kx = 0; kx < kw; ++kx) {
                                int64_t y = oy * stride + ky - padding;
                                int64_t x = ox * stride + kx - padding;
                                if (y < 0 || x < 0 || y >= H || x >= W) continue;
                                f(size_t(((n * C + c) * H + y) * W + x),
                                  size_t(((o * C + c) * kh + ky) * kw + kx),
                                  size_t(((n * O + o) * OH + oy) * OW + ox));
                            }
}

void addBias(Value& y, const Values& v) {
    if (!v.contains("bias")) return;
    size_t plane = size(y, 2) * size(y, 3);
    for (size_t i = 0; i < y.data.size(); ++i)
        y.data[i] += v.at("bias").data[i / plane % size(y, 1)];
}

Values convReference(const Values& v) {
    const Value &x = v.at("x"), &w = v.at("weight");
    auto s = int64_t(v.at("stride").data[0]), p = int64_t(v.at("padding").data[0]);
    Value y{{x.shape[0], w.shape[0], (x.shape[2] + 2 * p - w.shape[2]) / s + 1,
             (x.shape[3] + 2 * p - w.shape[3]) / s + 1},
            {}};
    y.data.resize(size_t(elementCount(y.shape)));
    forEachProduct(x.shape, w.shape, s, p,
                   [&](size_t i, size_t k, size_t o) { y.data[o] += x.data[i] * w.data[k]; });
    addBias(y, v);
    return {{"y", y}};
}

Values transposedReference(const Values& v) {
    const Value &x = v.at("x"), &w = v.at("weight");
    auto s = int64_t(v.at("stride").data[0]), p = int64_t(v.at("padding").data[0]);
    Value y{{x.shape[0], w.shape[1], (x.shape[2] - 1) * s - 2 * p + w.shape[2],
             (x.shape[3] - 1) * s - 2 * p + w.shape[3]},
            {}};
    y.data.resize(size_t(elementCount(y.shape)));
    forEachProduct(y.shape, w.shape, s, p,
                   [&](size_t i, size_t k, size_t o) { y.data[i] += x.data[o] * w.data[k]; });
    addBias(y, v);
    return {{"y", y}};
}

struct Case {
    Shape x, weight;
    int stride, padding;
    bool bias = true;
};

void checkConvolution(const char* op, const Case& c, int64_t features,
                      Values (*reference)(const Values&)) {
    SCOPED_TRACE(fmt::format("{} {} stride {} padding {}", toString(c.x), toString(c.weight),
                             c.stride, c.padding));
    OpCase opCase{.inputs = {{"x", random(c.x, 1)}, {"weight", random(c.weight, 2)}},
                  .attributes = {{"stride", c.stride}, {"padding", c.padding}},
                  .reference = reference,
                  .samples = 2};
    if (c.bias) opCase.inputs["bias"] = random({features}, 3);
    checkOp(op, opCase);
}

// What quotient() of common/divide.h does in a shader.
TEST(Conv, DivisionByMultiplication) {
    auto quotient = [](uint32_t value, const Divisor& by) {
        auto high = static_cast<uint32_t>((uint64_t{value} * by.multiplier) >> 32);
        return by.multiplier == 0 ? value : high >> by.shift;
    };
    std::mt19937 generator(3);
    for (uint32_t divisor = 1; divisor < 3000; ++divisor) {
        Divisor by = divisorOf(divisor);
        for (uint32_t value : {0u, divisor - 1, divisor, 7 * divisor - 1, 7 * divisor, 0x7fffffffu,
                               static_cast<uint32_t>(generator() >> 1)})
            ASSERT_EQ(quotient(value, by), value / divisor) << value << " / " << divisor;
    }
    for (uint32_t divisor : {65535u, 65536u, 65537u, 0x3fffffffu, 0x40000001u, 0x7fffffffu})
        for (int i = 0; i < 1000; ++i) {
            auto value = static_cast<uint32_t>(generator() >> 1);
            ASSERT_EQ(quotient(value, divisorOf(divisor)), value / divisor);
        }
}

TEST(Conv, Conv2d) {
    const Case cases[] = {
        {{1, 1, 1, 1}, {1, 1, 1, 1}, 1, 0},         {{2, 3, 6, 8}, {5, 3, 4, 4}, 2, 1},
        {{1, 2, 13, 7}, {3, 2, 4, 4}, 1, 1, false}, {{2, 2, 13, 5}, {1, 2, 3, 2}, 3, 2},
        {{1, 1, 2, 2}, {4, 1, 4, 4}, 2, 1},         {{1, 13, 5, 5}, {2, 13, 5, 5}, 1, 0}};
    for (const Case& c : cases) checkConvolution("conv2d", c, c.weight[0], convReference);
}

// Windows at the edges of a panel of them, and weights at the edges of a panel of these: of 2x3 so
// that a channel has six rows.
TEST(Conv, PanelEdges) {
    const int64_t many = 1000, width = gemmPanelWidth(testDevice(), many);
    std::vector<Case> cases;
    for (int64_t n : edgeSizes(width)) cases.push_back({{1, 2, 2, n + 2}, {3, 2, 2, 3}, 1, 0});
    for (int64_t n : edgeSizes(width / 6)) cases.push_back({{1, n, 3, 5}, {2, n, 2, 3}, 1, 0});
    for (int64_t n : edgeSizes(gemmPanelRows(testDevice(), many)))
        cases.push_back({{2, 1, 3, 4}, {n, 1, 2, 3}, 1, 1, false});
    for (const Case& c : cases) checkConvolution("conv2d", c, c.weight[0], convReference);
    for (int64_t n : edgeSizes(width))
        checkConvolution("conv_transpose2d", {{1, 3, 1, n}, {3, 2, 2, 3}, 1, 0}, 2,
                         transposedReference);
}

// Layers of one feature exchange the roles of image and map; of other strides and of few channels
// they do not.
TEST(Conv, OneFeature) {
    const Case cases[] = {{{2, 8, 9, 12}, {1, 8, 4, 4}, 1, 1},
                          {{1, 20, 7, 5}, {1, 20, 3, 3}, 1, 2, false},
                          {{1, 9, 6, 6}, {1, 9, 1, 1}, 1, 0},
                          {{1, 9, 8, 6}, {1, 9, 4, 4}, 1, 3},
                          {{2, 8, 9, 12}, {1, 8, 4, 4}, 2, 1}};
    for (const Case& c : cases) {
        checkConvolution("conv2d", c, 1, convReference);
        Case transposed = c;
        auto out = [&](int64_t size) {
            return (size + 2 * c.padding - c.weight[2]) / c.stride + 1;
        };
        transposed.x = {c.x[0], 1, out(c.x[2]), out(c.x[3])};
        checkConvolution("conv_transpose2d", transposed, c.weight[1], transposedReference);
    }
}

// Images of few channels under many windows of 4x4 and stride 2, several at once.
TEST(Conv, FewChannels) {
    const Case cases[] = {{{1, 3, 32, 36}, {5, 3, 4, 4}, 2, 1},
                          {{2, 12, 40, 32}, {3, 12, 4, 4}, 2, 1, false},
                          {{1, 13, 34, 36}, {2, 13, 4, 4}, 2, 1},
                          {{1, 8, 36, 34}, {2, 8, 4, 4}, 2, 1}};
    for (const Case& c : cases) {
        checkConvolution("conv2d", c, c.weight[0], convReference);
        Case transposed = c;
        transposed.x = {c.x[0], c.weight[0], c.x[2] / 2, c.x[3] / 2};
        checkConvolution("conv_transpose2d", transposed, c.weight[1], transposedReference);
    }
}

// Large enough for Winograd's way: tiles of one image and of several, in panels that are full and
// that are not; of stride 2, small ones and large ones.
TEST(Conv, Winograd) {
    const Case cases[] = {
        {{1, 16, 32, 32}, {17, 16, 4, 4}, 2, 1}, {{3, 17, 12, 40}, {16, 17, 4, 4}, 2, 1, false},
        {{1, 16, 64, 64}, {17, 16, 4, 4}, 2, 1}, {{3, 18, 40, 48}, {16, 18, 4, 4}, 2, 1, false},
        {{1, 17, 31, 34}, {16, 17, 4, 4}, 1, 1}, {{5, 16, 15, 15}, {18, 16, 4, 4}, 1, 3, false},
        {{1, 17, 32, 34}, {16, 17, 3, 3}, 1, 1}, {{5, 16, 15, 14}, {18, 16, 3, 3}, 1, 2, false},
        {{2, 16, 31, 33}, {16, 16, 3, 3}, 1, 0}};
    for (const Case& c : cases) {
        checkConvolution("conv2d", c, c.weight[0], convReference);
        Case transposed = c;
        auto out = [&](int64_t size) {
            return (size + 2 * c.padding - c.weight[2]) / c.stride + 1;
        };
        transposed.x = {c.x[0], c.weight[0], out(c.x[2]), out(c.x[3])};
        checkConvolution("conv_transpose2d", transposed, c.weight[1], transposedReference);
    }
}

// Maps whose sides are at the edges of Winograd's tiles, of 4x4 windows, or of 2x2 (stride 2, whose
// images have sides of whole pairs of tiles); channels and features at the edges of panels.
TEST(Conv, WinogradTileEdges) {
    std::vector<Case> cases;
    for (int64_t kernel : {3, 4})
        for (int64_t over = 0; over < 4; ++over) {
            // Maps of 4·5 + over by 4·4 + (3 - over) windows.
            cases.push_back({{1, 16, 20 + over + kernel - 1, 19 - over + kernel - 1},
                             {16, 16, kernel, kernel},
                             1,
                             0});
        }
    const int64_t rows = gemmPanelRows(testDevice(), 1000);
    for (int64_t c : {rows - 1, rows, rows + 1}) {
        cases.push_back({{1, c, 18, 23}, {16, c, 4, 4}, 1, 1});
        cases.push_back({{1, 16, 18, 23}, {c, 16, 3, 3}, 1, 1});
        cases.push_back({{1, c, 32, 32}, {16, c, 4, 4}, 2, 1});
        cases.push_back({{2, 16, 16, 40}, {c, 16, 4, 4}, 2, 1});
    }
    for (int64_t tiles : {7, 8, 9}) cases.push_back({{tiles, 16, 12, 24}, {16, 16, 4, 4}, 2, 1});
    for (const Case& c : cases) checkConvolution("conv2d", c, c.weight[0], convReference);
}

// Layers whose transformed weights are made in parts: their first and last features and channels
// are those of small layers, which have one part and the reference above.
TEST(Conv, WinogradInParts) {
    struct Layer {
        int64_t channels, features, image, maps;
        int stride;
    };
    // A part of the elements along an axis of a tensor.
    auto cut = [](const Value& v, size_t axis, int64_t first, int64_t count) {
        Value part = v;
        part.shape[axis] = count;
        part.data.clear();
        auto inner = int64_t{1};
        for (size_t d = axis + 1; d < v.shape.size(); ++d) inner *= v.shape[d];
        for (int64_t i = 0; i < int64_t(v.data.size()); ++i) {
            int64_t at = i / inner % v.shape[axis];
            if (at >= first && at < first + count) part.data.push_back(v.data[size_t(i)]);
        }
        return part;
    };
    for (const Layer& l :
         {Layer{128, 256, 32, 16, 2}, {64, 192, 64, 32, 2}, {64, 384, 20, 19, 1}}) {
        SCOPED_TRACE(fmt::format("{} to {} channels", l.channels, l.features));
        Value image = random({1, l.channels, l.image, l.image}, 1);
        Value maps = random({1, l.features, l.maps, l.maps}, 2);
        Value weight = random({l.features, l.channels, 4, 4}, 3);
        Value perFeature = random({l.features}, 4), perChannel = random({l.channels}, 5);
        auto run = [&](const char* op, const Value& x, const Value& w, const Value& bias,
                       const Value& dy) {
            Npz in;
            in.set("x", Array::f64(x.shape, x.data));
            in.set("weight", Array::f64(w.shape, w.data));
            in.set("bias", Array::f64(bias.shape, bias.data));
            in.set("grad_y", Array::f64(dy.shape, dy.data));
            in.set("attr_stride", Array::scalarF64(l.stride));
            in.set("attr_padding", Array::scalarF64(1));
            return Op::find(op)->run(testDevice(), in, {});
        };
        auto expectPart = [&](const Npz& whole, const char* name, size_t axis, int64_t first,
                              const Npz& part) {
            Value all{whole.at(name).shape, whole.at(name).toF64()};
            EXPECT_LE(relativeError(cut(all, axis, first, 32).data, part.at(name).toF64(), 1e-12),
                      1e-5)
                << name << " from " << first;
        };
        Npz conv = run("conv2d", image, weight, perFeature, maps);
        Npz transposed = run("conv_transpose2d", maps, weight, perChannel, image);
        for (int64_t f : {int64_t{0}, l.features - 32}) {
            Value some = cut(weight, 0, f, 32), given = cut(maps, 1, f, 32);
            Npz part = run("conv2d", image, some, cut(perFeature, 0, f, 32), given);
            expectPart(conv, "y", 1, f, part);
            expectPart(conv, "grad_weight", 0, f, part);
            part = run("conv_transpose2d", given, some, perChannel, image);
            expectPart(transposed, "grad_x", 1, f, part);
            expectPart(transposed, "grad_weight", 0, f, part);
        }
        for (int64_t c : {int64_t{0}, l.channels - 32}) {
            Value some = cut(weight, 1, c, 32), given = cut(image, 1, c, 32);
            Npz part = run("conv2d", given, some, perFeature, maps);
            expectPart(conv, "grad_x", 1, c, part);
            part = run("conv_transpose2d", maps, some, cut(perChannel, 0, c, 32), given);
            expectPart(transposed, "y", 1, c, part);
        }
    }
}

// Halves take other points, or columns (kernels 3x3): all as good as products of halves are.
TEST(Conv, WinogradWithMixedPrecision) {
    const Case cases[] = {{{1, 16, 64, 64}, {17, 16, 4, 4}, 2, 1},
                          {{2, 17, 31, 34}, {16, 17, 4, 4}, 1, 1},
                          {{2, 17, 31, 34}, {16, 17, 3, 3}, 1, 1}};
    for (const Case& c : cases) {
        SCOPED_TRACE(toString(c.weight));
        auto run = [&](Precision precision) {
            Npz in;
            auto set = [&](const char* name, const Shape& shape, uint32_t seed) {
                in.set(name, Array::f64(shape, random(shape, seed).data));
            };
            auto out = [&](int64_t size) {
                return (size + 2 * c.padding - c.weight[2]) / c.stride + 1;
            };
            set("x", c.x, 1);
            set("weight", c.weight, 2);
            set("grad_y", {c.x[0], c.weight[0], out(c.x[2]), out(c.x[3])}, 3);
            in.set("attr_stride", Array::scalarF64(c.stride));
            in.set("attr_padding", Array::scalarF64(c.padding));
            return Op::find("conv2d")->run(testDevice(precision), in, {});
        };
        Npz mixed = run(Precision::Mixed), single = run(Precision::Single);
        for (const char* name : {"y", "grad_x", "grad_weight"}) {
            double error = relativeError(mixed.at(name).toF64(), single.at(name).toF64(), 1e-12);
            EXPECT_LE(error, 2e-3) << name;
            EXPECT_GE(error, 1e-5) << name << " is of single precision";
        }
    }
}

// Kernels 1x1 are products with the images themselves.
TEST(Conv, SinglePixels) {
    const Case cases[] = {{{1, 20, 9, 7}, {33, 20, 1, 1}, 1, 0},
                          {{3, 5, 4, 6}, {7, 5, 1, 1}, 1, 0, false},
                          {{2, 5, 4, 6}, {7, 5, 1, 1}, 2, 1}};
    for (const Case& c : cases) {
        checkConvolution("conv2d", c, c.weight[0], convReference);
        if (c.stride > 1) continue;
        Case transposed = c;
        transposed.x[1] = c.weight[0];
        checkConvolution("conv_transpose2d", transposed, c.weight[1], transposedReference);
    }
}

// Which layers take Winograd's way; not one whose matrices the kernels cannot count.
TEST(Conv, WinogradPays) {
    auto pays = [](int64_t channels, int64_t side, int64_t stride, int64_t kernel = 4) {
        return kWinogradConvolution.pays(testDevice(), {.images = 1,
                                           .channels = channels,
                                           .height = side,
                                           .width = side,
                                           .features = 64,
                                           .kernelH = kernel,
                                           .kernelW = kernel,
                                           .stride = stride,
                                           .padding = 1,
                                           .outHeight = (side + 2 - kernel) / stride + 1,
                                           .outWidth = (side + 2 - kernel) / stride + 1});
    };
    EXPECT_TRUE(pays(64, 256, 2));
    EXPECT_TRUE(pays(64, 255, 1));
    EXPECT_FALSE(pays(3, 256, 2));
    EXPECT_FALSE(pays(64, 254, 2));
    EXPECT_FALSE(pays(64, 16, 2));
    EXPECT_FALSE(pays(64, 5600, 2));
    EXPECT_FALSE(pays(64, 3600, 1));
    EXPECT_TRUE(pays(64, 256, 1, 3));
    EXPECT_FALSE(pays(64, 256, 2, 3));
    EXPECT_FALSE(pays(64, 256, 1, 5));
}

TEST(Conv, ConvTranspose2d) {
    const Case cases[] = {{{1, 1, 1, 1}, {1, 1, 1, 1}, 1, 0},
                          {{2, 3, 3, 4}, {3, 5, 4, 4}, 2, 1},
                          {{1, 2, 13, 7}, {2, 3, 4, 4}, 1, 1, false},
                          {{2, 2, 4, 3}, {2, 1, 2, 3}, 3, 1},
                          {{2, 4, 1, 1}, {4, 3, 4, 4}, 2, 1}};
    for (const Case& c : cases)
        checkConvolution("conv_transpose2d", c, c.weight[1], transposedReference);
}

// The columns of this layer do not fit into one piece: 32·16 rows of 128·128 windows.
TEST(Conv, InPieces) {
    Case c{{2, 32, 130, 130}, {2, 32, 4, 4}, 1, 1};
    Values in = {{"x", random(c.x, 1)},
                 {"weight", random(c.weight, 2)},
                 {"stride", {{}, {1}}},
                 {"padding", {{}, {1}}}};
    auto run = [&](const char* op, const Value& x, const Value& weight, const Value& dy) {
        Npz arrays;
        arrays.set("x", Array::f64(x.shape, x.data));
        arrays.set("weight", Array::f64(weight.shape, weight.data));
        arrays.set("grad_y", Array::f64(dy.shape, dy.data));
        arrays.set("attr_stride", Array::scalarF64(1));
        arrays.set("attr_padding", Array::scalarF64(1));
        return Op::find(op)->run(testDevice(), arrays, {.reuseMemory = false, .poison = true});
    };
    Value y = convReference(in).at("y"), dy = random(y.shape, 3);
    Value dx =
        transposedReference(
            {{"x", dy}, {"weight", in.at("weight")}, {"stride", {{}, {1}}}, {"padding", {{}, {1}}}})
            .at("y");
    Value dw{c.weight, std::vector<double>(in.at("weight").data.size())};
    forEachProduct(c.x, c.weight, 1, 1, [&](size_t i, size_t k, size_t o) {
        dw.data[k] += in.at("x").data[i] * dy.data[o];
    });
    Npz out = run("conv2d", in.at("x"), in.at("weight"), dy);
    EXPECT_LE(relativeError(out.at("y").toF64(), y.data, 1e-6), 2e-5);
    EXPECT_LE(relativeError(out.at("grad_x").toF64(), dx.data, 1e-6), 2e-5);
    EXPECT_LE(relativeError(out.at("grad_weight").toF64(), dw.data, 1e-6), 2e-5);
    // The transposed convolution of dy is dx; its gradient is the convolution.
    Npz back = run("conv_transpose2d", dy, in.at("weight"), in.at("x"));
    EXPECT_LE(relativeError(back.at("y").toF64(), dx.data, 1e-6), 2e-5);
    EXPECT_LE(relativeError(back.at("grad_x").toF64(), y.data, 1e-6), 2e-5);
    EXPECT_LE(relativeError(back.at("grad_weight").toF64(), dw.data, 1e-6), 2e-5);
}

Value normalise(const Values& v, bool training) {
    const Value& x = v.at("x");
    size_t N = size(x, 0), C = size(x, 1), P = size(x, 2) * size(x, 3);
    Value y = x;
    for (size_t c = 0; c < C; ++c) {
        double mean = 0, variance = 0;
        auto each = [&](auto f) {
            for (size_t n = 0; n < N; ++n)
                for (size_t p = 0; p < P; ++p) f((n * C + c) * P + p);
        };
        each([&](size_t i) { mean += x.data[i] / double(N * P); });
        each([&](size_t i) { variance += std::pow(x.data[i] - mean, 2) / double(N * P); });
        if (!training) {
            mean = v.at("running_mean").data[c];
            variance = v.at("running_variance").data[c];
        }
        each([&](size_t i) {
            double value = (x.data[i] - mean) / std::sqrt(variance + v.at("eps").data[0]) *
                               v.at("weight").data[c] +
                           v.at("bias").data[c];
            y.data[i] = value > 0 ? value : v.at("slope").data[0] * value;
        });
    }
    return y;
}

TEST(Conv, BatchNorm2d) {
    std::vector<Shape> shapes{{5, 1, 1, 1},   {1, 13, 7, 1},  {3, 2, 5, 127}, {2, 3, 6, 40},
                              {1, 2, 66, 70}, {2, 2, 51, 51}, {2, 3, 64, 64}, {3, 2, 32, 64}};
    // The edges of a subgroup's vector, of what an invocation takes, of a workgroup of sums; of the
    // largest channel that one workgroup has alone; blocks of four subgroups and not of sixteen.
    for (int64_t tile : {8, 64})
        for (int64_t n : edgeSizes(tile)) shapes.push_back({5, 2, 1, n});
    constexpr int64_t kSmall = 4096;
    for (int64_t n : {kSmall - 1, kSmall, kSmall + 1, kSmall + 2}) shapes.push_back({1, 1, 1, n});
    shapes.push_back({1, 2, 4 * 5, kChunkElements});
    for (const Shape& shape : shapes) {
        int64_t C = shape[1];
        Values inputs = {
            {"x", random(shape, 1)}, {"weight", random({C}, 2)}, {"bias", random({C}, 3)}};
        // Far from zero, where a mean of squares would lose the variance.
        for (double& x : inputs.at("x").data) x += 10;
        checkOp("batch_norm2d",
                {.inputs = inputs,
                 .attributes = {{"eps", 1e-5}, {"slope", shape[3] % 8 == 0 ? 0.2 : 1}},
                 .reference = [](const Values& v) -> Values {
                     return {{"y", normalise(v, true)}};
                 },
                 .forwardTolerance = 1e-4});
        for (double& x : inputs.at("x").data) x -= 10;
        inputs["running_mean"] = random({C}, 4);
        inputs["running_variance"] = uniform({C}, 0.5, 2, 5);
        checkOp("batch_norm2d_evaluation",
                {.inputs = inputs,
                 .attributes = {{"eps", 1e-5}, {"slope", shape[3] % 8 == 0 ? 0.2 : 1}},
                 .reference = [](const Values& v) -> Values {
                     return {{"y", normalise(v, false)}};
                 }});
    }
}

// One channel of images [n, 1, side, side], mean 3 and variance 2 (biased) of [1, 3, 3, 5].
void checkRunningStatistics(const Shape& shape) {
    auto count = static_cast<size_t>(elementCount(shape));
    Buffer memory = testDevice().allocate(32, Memory::Device);
    std::vector<float> start{1, 0, 0, 0, 2, 0, 0, 0}, values(count);
    testDevice().upload({&memory, 0, 32}, std::as_bytes(std::span(start)));
    Graph graph(testDevice());
    Tensor x = graph.input(shape), w = graph.input({1}), b = graph.input({1});
    RunningStatistics running{graph.attach({&memory, 0, 4}, {1}),
                              graph.attach({&memory, 16, 4}, {1})};
    graph.output(batchNorm2d(graph, x, w, b, {}, running));
    graph.compile({.poison = true});
    for (size_t i = 0; i < count; ++i) values[i] = std::array{1.f, 3.f, 3.f, 5.f}[i % 4];
    graph.write(x, values);
    graph.write(w, std::vector<float>{1});
    double mean = 1, variance = 2, n = static_cast<double>(count);
    for (int step = 0; step < 3; ++step) {
        graph.run();
        mean = 0.9 * mean + 0.1 * 3;
        variance = 0.9 * variance + 0.1 * 2 * n / (n - 1);
        testDevice().download({&memory, 0, 32}, std::as_writable_bytes(std::span(start)));
        EXPECT_NEAR(start[0], mean, 1e-6) << toString(shape);
        EXPECT_NEAR(start[4], variance, 1e-6) << toString(shape);
    }
}

TEST(Conv, RunningStatisticsFollowTheBatches) {
    for (const Shape& shape : {Shape{2, 1, 1, 2}, Shape{2, 1, 51, 54}, Shape{2, 1, 64, 64}})
        checkRunningStatistics(shape);
}

TEST(Conv, Refusals) {
    auto run = [](const char* op, Shape x, Shape weight, double stride, double padding) {
        Npz in;
        in.set("x", Array::f32(x, std::vector<float>(size_t(elementCount(x)))));
        in.set("weight", Array::f32(weight, std::vector<float>(size_t(elementCount(weight)))));
        in.set("attr_stride", Array::scalarF64(stride));
        in.set("attr_padding", Array::scalarF64(padding));
        Op::find(op)->run(testDevice(), in, {});
    };
    expectInputError(
        [&] {
            run("conv2d", {1, 1, 2, 2}, {1, 1, 4, 4}, 1, 0);
        },
        "a kernel of 4x4 is larger than the padded image of 2x2");
    expectInputError([&] { run("conv2d", {1, 1, 2, 2}, {1, 1, 1, 1}, 0, 0); }, "attr_stride");
    expectInputError(
        [&] {
            run("conv_transpose2d", {1, 1, 1, 1}, {1, 1, 2, 2}, 1, 1);
        },
        "attr_padding: 1 leaves nothing");
}

}  // namespace
}  // namespace doppel
