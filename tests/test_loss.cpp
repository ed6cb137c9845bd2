#include "nn/ops/loss.h"

#include <algorithm>
#include <cmath>

#include "loss/params.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

Value scalar(double value) { return {{}, {value}}; }

Npz arraysOf(const Values& inputs, const std::map<std::string, double>& attributes = {}) {
    Npz arrays;
    for (const auto& [name, value] : inputs) {
        std::vector<float> values(value.data.begin(), value.data.end());
        arrays.set(name, Array::f32(value.shape, values));
    }
    for (const auto& [name, value] : attributes)
        arrays.set("attr_" + name, Array::scalarF64(value));
    return arrays;
}

Npz runOp(const std::string& op, const Npz& arrays) {
    return Op::find(op)->run(testDevice(), arrays, {.reuseMemory = false, .poison = true});
}

Value binary(Shape shape, uint32_t seed) {
    Value value = uniform(std::move(shape), 0, 1, seed);
    for (double& x : value.data) x = x > 0.5;
    return value;
}

constexpr int64_t kPartials = 1024;  // of nn/ops/loss.cpp: first sums, each of every 1024th pixel

// Pixels at the edges of the first sums.
std::vector<Shape> sizes() {
    std::vector<Shape> all{{1, 1}, {13, 1}, {37, 53}, {1, 127}, {64, 65}, {64, 96}};
    for (int64_t n : edgeSizes(kPartials)) all.push_back({1, n});
    return all;
}

// ---- silhouettes --------------------------------------------------------------------------------

Values iouReference(const Values& v) {
    double intersection = 0, together = 0;
    for (size_t i = 0; i < v.at("predicted").data.size(); ++i) {
        double p = v.at("predicted").data[i], g = v.at("target").data[i];
        intersection += p * g;
        together += p + g - p * g;
    }
    return {{"loss", scalar(together == 0 ? 0 : 1 - intersection / together)}};
}

TEST(SilhouetteIouLoss, AgainstPlainLoop) {
    for (const Shape& size : sizes())
        for (Value target : {binary(size, 2), uniform(size, 0, 1, 2)})
            checkOp("silhouette_iou_loss",
                    {.inputs = {{"predicted", uniform(size, 0, 1)}, {"target", target}},
                     .reference = iouReference});
}

TEST(SilhouetteIouLoss, EmptyPictures) {
    Value none{{5, 7}, std::vector<double>(35)}, some = uniform({5, 7}, 0, 1);
    auto run = [](const Value& predicted, const Value& target) {
        Npz arrays = arraysOf({{"predicted", predicted}, {"target", target}});
        arrays.set("grad_loss", Array::scalarF32(1));
        return runOp("silhouette_iou_loss", arrays);
    };
    Npz both = run(none, none), wrong = run(some, none), missing = run(none, some);
    EXPECT_EQ(both.at("loss").scalar(), 0);
    EXPECT_EQ(wrong.at("loss").scalar(), 1);
    EXPECT_EQ(missing.at("loss").scalar(), 1);
    EXPECT_EQ(both.at("grad_predicted").toF32(), std::vector<float>(35));
    EXPECT_EQ(wrong.at("grad_predicted").toF32(), std::vector<float>(35));
    for (float g : missing.at("grad_predicted").toF32()) EXPECT_LT(g, 0);
}

// ---- colours ------------------------------------------------------------------------------------

Values maskedL1Reference(const Values& v) {
    double sum = 0, count = 0;
    for (size_t i = 0; i < v.at("mask").data.size(); ++i) {
        count += v.at("mask").data[i];
        for (size_t c = 3 * i; c < 3 * i + 3; ++c)
            sum +=
                std::abs(v.at("predicted").data[c] - v.at("target").data[c]) * v.at("mask").data[i];
    }
    return {{"loss", scalar(count == 0 ? 0 : sum / count)}};
}

TEST(MaskedL1Loss, AgainstPlainLoop) {
    for (const Shape& size : sizes())
        for (Value mask : {binary(size, 3), uniform(size, 0.1, 1, 3)}) {
            Shape colours{size[0], size[1], 3};
            OpCase test{.inputs = {{"predicted", uniform(colours, 0, 1, 1)},
                                   {"target", uniform(colours, 0, 1, 2)},
                                   {"mask", mask}},
                        .reference = maskedL1Reference};
            // The loss has a kink where both are the same.
            test.skip = [&](const std::string&, int64_t i) {
                return std::abs(test.inputs.at("predicted").data[size_t(i)] -
                                test.inputs.at("target").data[size_t(i)]) < 4 * test.differenceStep;
            };
            checkOp("masked_l1_loss", test);
        }
}

TEST(MaskedL1Loss, EmptyMaskAndEqualPictures) {
    for (const Shape& size : {Shape{4, 9}, Shape{64, 96}}) {
        Shape colours{size[0], size[1], 3};
        auto pixels = static_cast<size_t>(elementCount(size));
        Value picture = uniform(colours, 0, 1), other = uniform(colours, 0, 1, 2);
        Value none{size, std::vector<double>(pixels)}, all{size, std::vector<double>(pixels, 1.0)};
        // What the mask leaves out may be anything.
        Value broken = picture;
        broken.data[5] = NAN;
        for (auto& [predicted, target, mask] :
             {std::tuple{picture, other, none}, {broken, other, none}, {picture, picture, all}}) {
            Npz arrays = arraysOf({{"predicted", predicted}, {"target", target}, {"mask", mask}});
            arrays.set("grad_loss", Array::scalarF32(1));
            Npz out = runOp("masked_l1_loss", arrays);
            EXPECT_EQ(out.at("loss").scalar(), 0);
            EXPECT_EQ(out.at("grad_predicted").toF32(), std::vector<float>(3 * pixels));
        }
    }
}

// ---- structural similarity ----------------------------------------------------------------------

Values ssimReference(const Values& v) {
    const Value &a = v.at("a"), &b = v.at("b");
    int64_t height = a.shape[0], width = a.shape[1], channels = a.shape[2];
    double window[11], sum = 0, total = 0;
    for (int k = 0; k < 11; ++k) sum += window[k] = std::exp(-(k - 5) * (k - 5) / 4.5);
    for (int64_t y = 0; y < height; ++y)
        for (int64_t x = 0; x < width; ++x)
            for (int64_t c = 0; c < channels; ++c) {
                double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
                for (int64_t dy = -5; dy <= 5; ++dy)
                    for (int64_t dx = -5; dx <= 5; ++dx) {
                        if (y + dy < 0 || y + dy >= height || x + dx < 0 || x + dx >= width)
                            continue;
                        double w = window[dy + 5] * window[dx + 5] / sum / sum;
                        auto i = size_t(((y + dy) * width + x + dx) * channels + c);
                        ma += w * a.data[i];
                        mb += w * b.data[i];
                        aa += w * a.data[i] * a.data[i];
                        bb += w * b.data[i] * b.data[i];
                        ab += w * a.data[i] * b.data[i];
                    }
                total += (2 * ma * mb + 1e-4) * (2 * (ab - ma * mb) + 9e-4) /
                         ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
            }
    return {{"ssim", scalar(total / double(height * width * channels))}};
}

TEST(Ssim, AgainstPlainLoop) {
    // A window is 11 pixels wide.
    for (Shape size : {Shape{1, 1, 1},
                       {13, 5, 3},
                       {3, 31, 2},
                       {20, 23, 3},
                       {10, 11, 1},
                       {11, 12, 1},
                       {12, 10, 1},
                       {32, 32, 1},
                       {25, 41, 1}}) {
        OpCase test;
        test.inputs = {{"a", uniform(size, 0, 1, 1)}, {"b", uniform(size, 0, 1, 2)}};
        // Alike, so that the covariance matters.
        for (size_t i = 0; i < test.inputs["b"].data.size(); ++i)
            test.inputs["b"].data[i] =
                0.7 * test.inputs["a"].data[i] + 0.3 * test.inputs["b"].data[i];
        test.reference = ssimReference;
        checkOp("ssim", test);
    }
}

TEST(Ssim, EqualPicturesGiveOne) {
    Value picture = uniform({20, 30, 3}, 0, 1);
    Npz arrays = arraysOf({{"a", picture}, {"b", picture}});
    arrays.set("grad_ssim", Array::scalarF32(1));
    Npz out = runOp("ssim", arrays);
    EXPECT_NEAR(out.at("ssim").scalar(), 1, 1e-6);
    for (float g : out.at("grad_a").toF32()) EXPECT_NEAR(g, 0, 1e-7);
}

// ---- keypoints ----------------------------------------------------------------------------------

Values keypointReference(const Values& v) {
    double sum = 0, weights = 0, scale = v.at("scale").data[0];
    for (size_t j = 0; j < v.at("joints").data.size() / 3; ++j) {
        const double *x = &v.at("joints").data[3 * j], *t = &v.at("targets").data[3 * j];
        if (x[2] <= 0.001 || !(t[2] > 0)) continue;
        double u = v.at("fx").data[0] * x[0] / x[2] + v.at("cx").data[0] - t[0];
        double w = v.at("fy").data[0] * x[1] / x[2] + v.at("cy").data[0] - t[1];
        sum += t[2] * (u * u + w * w) / (u * u + w * w + scale * scale);
        weights += t[2];
    }
    return {{"loss", scalar(weights == 0 ? 0 : sum / weights)}};
}

TEST(KeypointLoss, AgainstPlainLoop) {
    for (int64_t count : {1, 13, 24, 63, 64, 65, 127})
        for (double scale : {5., 60.}) {
            OpCase test;
            test.inputs = {{"joints", uniform({count, 3}, -0.5, 0.5, 1)},
                           {"targets", uniform({count, 3}, 0, 1, 2)}};
            for (size_t j = 0; j < size_t(count); ++j) {
                double& z = test.inputs["joints"].data[3 * j + 2];
                z = j % 7 == 5 ? -1 - z : z + 2;  // some behind the camera
                test.inputs["targets"].data[3 * j] *= 128;
                test.inputs["targets"].data[3 * j + 1] *= 96;
                if (j % 5 == 4) test.inputs["targets"].data[3 * j + 2] = 0;  // some not seen
            }
            test.attributes = {{"fx", 150}, {"fy", 140}, {"cx", 64}, {"cy", 48}, {"scale", scale}};
            test.reference = keypointReference;
            checkOp("keypoint_loss", test);
        }
}

TEST(KeypointLoss, NothingSeenGivesZero) {
    Value targets{{3, 3}, {NAN, NAN, 0, 5, 5, 0, 7, 7, 1}};
    Value joints{{3, 3}, {0, 0, 2, 0.1, 0, 2, 0.2, 0, -1}};
    Npz arrays = arraysOf({{"joints", joints}, {"targets", targets}},
                          {{"fx", 9}, {"fy", 9}, {"cx", 4}, {"cy", 4}, {"scale", 3}});
    arrays.set("grad_loss", Array::scalarF32(1));
    Npz out = runOp("keypoint_loss", arrays);
    EXPECT_EQ(out.at("loss").scalar(), 0);
    EXPECT_EQ(out.at("grad_joints").toF32(), std::vector<float>(9));
    arrays.set("attr_scale", Array::scalarF64(0));
    expectInputError([&] { runOp("keypoint_loss", arrays); },
                     "attr_scale: expected pixels above 0");
}

// ---- dilation -----------------------------------------------------------------------------------

TEST(Dilate3, AgainstPlainLoop) {
    for (Shape size : {Shape{1, 1, 1},
                       {2, 1, 13},
                       {3, 13, 1},
                       {2, 11, 127},
                       {1, 2, 2},
                       {1, 7, 9},
                       {1, 8, 8},
                       {1, 9, 7}})
        // Negative values too: beyond the border is 0.
        for (Value x : {uniform(size, -1, 1), uniform(size, 0, 1)})
            checkOp("dilate3", {.inputs = {{"x", x}}, .reference = [](const Values& v) {
                                    Value y = v.at("x");
                                    const Value& in = v.at("x");
                                    int64_t h = in.shape[1], w = in.shape[2];
                                    for (int64_t i = 0; i < int64_t(y.data.size()); ++i) {
                                        int64_t n = i / (h * w), r = i / w % h, c = i % w;
                                        double most = -INFINITY;
                                        for (int64_t a = r - 1; a <= r + 1; ++a)
                                            for (int64_t b = c - 1; b <= c + 1; ++b) {
                                                bool in3 = a >= 0 && a < h && b >= 0 && b < w;
                                                most = std::max(
                                                    most,
                                                    in3 ? in.data[size_t((n * h + a) * w + b)] : 0);
                                            }
                                        y.data[size_t(i)] = most;
                                    }
                                    return Values{{"y", y}};
                                }});
}

// ---- laws ---------------------------------------------------------------------------------------

Values pyramidReference(const Values& in) {
    const Value& a = in.at("a");
    const auto height = size_t(a.shape[0]), width = size_t(a.shape[1]);
    const size_t channels = a.shape.size() > 2 ? size_t(a.shape[2]) : 1;
    const double epsilon = in.at("epsilon").data[0];
    double loss = 0;
    for (size_t cell : {1, 2, 4, 8})
        for (size_t y = 0; y < height; y += cell)
            for (size_t x = 0; x < width; x += cell)
                for (size_t c = 0; c < channels; ++c) {
                    double sum = 0;
                    for (size_t v = y; v < std::min(y + cell, height); ++v)
                        for (size_t u = x; u < std::min(x + cell, width); ++u) {
                            const size_t i = (v * width + u) * channels + c;
                            sum += in.at("counts").data[v * width + u] *
                                   (a.data[i] - in.at("b").data[i]);
                        }
                    const double n = double(cell * cell), d = sum / n;
                    const double rho =
                        epsilon > 0 ? std::sqrt(d * d + epsilon * epsilon) - epsilon : d * d;
                    loss += in.at("weight" + std::to_string(cell)).data[0] * n * rho;
                }
    return {{"loss", {{}, {loss * in.at("scale").data[0]}}}};
}

TEST(PyramidLoss, AgainstPlainLoop) {
    for (const Shape& shape : {Shape{16, 24}, {1, 1}, {9, 7, 3}, {8, 8, 1}, {23, 17, 4}, {7, 33}})
        for (double epsilon : {0., .02, .5}) {
            SCOPED_TRACE(fmt::format("{} epsilon {}", toString(shape), epsilon));
            checkOp("pyramid_loss", {.inputs = {{"a", uniform(shape, 0, 1, 1)},
                                                {"b", uniform(shape, 0, 1, 2)},
                                                {"counts", uniform({shape[0], shape[1]}, 0, 1, 3)},
                                                {"scale", {{1}, {.37}}}},
                                     .attributes = {{"weight1", .7},
                                                    {"weight2", .5},
                                                    {"weight4", .25},
                                                    {"weight8", 2},
                                                    {"epsilon", epsilon}},
                                     .reference = pyramidReference});
        }
}

TEST(PyramidLoss, EqualPicturesGiveZero) {
    const Value a = uniform({13, 11, 3}, 0, 1, 1);
    for (double epsilon : {0., .02})
        checkOp("pyramid_loss", {.inputs = {{"a", a},
                                            {"b", a},
                                            {"counts", uniform({13, 11}, 0, 1, 3)},
                                            {"scale", {{1}, {1}}}},
                                 .attributes = {{"weight1", 1},
                                                {"weight2", 1},
                                                {"weight4", 1},
                                                {"weight8", 1},
                                                {"epsilon", epsilon}},
                                 .reference = pyramidReference});
}

TEST(Losses, SameBitsTwice) {
    Shape size{100, 90, 3};
    Npz arrays = arraysOf({{"predicted", uniform(size, 0, 1, 1)},
                           {"target", uniform(size, 0, 1, 2)},
                           {"mask", binary({100, 90}, 3)}});
    arrays.set("grad_loss", Array::scalarF32(1));
    Npz first = runOp("masked_l1_loss", arrays), second = runOp("masked_l1_loss", arrays);
    EXPECT_EQ(first.at("loss").bytes, second.at("loss").bytes);
    EXPECT_EQ(first.at("grad_predicted").bytes, second.at("grad_predicted").bytes);
    arrays = arraysOf({{"a", uniform(size, 0, 1, 1)}, {"b", uniform(size, 0, 1, 2)}});
    arrays.set("grad_ssim", Array::scalarF32(1));
    first = runOp("ssim", arrays), second = runOp("ssim", arrays);
    EXPECT_EQ(first.at("ssim").bytes, second.at("ssim").bytes);
    EXPECT_EQ(first.at("grad_a").bytes, second.at("grad_a").bytes);
}

}  // namespace
}  // namespace doppel
