#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "engine/files/npz.h"
#include "trainer/eval/metrics.h"

namespace doppel {
namespace {

std::vector<float> noise(size_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(0, 1);
    std::vector<float> values(count);
    for (float& value : values) value = uniform(random);
    return values;
}

TEST(Metrics, Iou) {
    const std::vector<uint8_t> a{255, 1, 0, 0}, b{0, 9, 9, 0}, none(4, 0);
    EXPECT_DOUBLE_EQ(intersectionOverUnion(a, b), 1. / 3);
    EXPECT_EQ(intersectionOverUnion(a, a), 1);
    EXPECT_EQ(intersectionOverUnion(a, none), 0);
    EXPECT_EQ(intersectionOverUnion(none, none), 1);
}

TEST(Metrics, MseAndPsnr) {
    const int width = 13, height = 7;
    std::vector<float> a(13 * 7 * 3, .5f), b = a;
    const auto same = comparePictures(a, b, width, height);
    EXPECT_EQ(same.mse, 0);
    EXPECT_EQ(same.psnr, 99);
    EXPECT_NEAR(same.ssim, 1, 1e-12);

    for (float& value : b) value += .1f;
    const auto off = comparePictures(a, b, width, height);
    EXPECT_NEAR(off.mse, 25.5 * 25.5, 1e-3);
    EXPECT_NEAR(off.psnr, 20, 1e-5);

    // Only what the mask shows.
    b = a;
    std::vector<uint8_t> mask(13 * 7, 0);
    mask[20] = 255, mask[21] = 1;
    b[60] = .8f;  // pixel 20, red
    b[0] = 0;     // outside
    const auto masked = comparePictures(a, b, width, height, mask);
    EXPECT_NEAR(masked.mse, .3 * .3 / 6 * 255 * 255, 1e-3);
    const auto nothing = comparePictures(a, b, width, height, std::vector<uint8_t>(13 * 7, 0));
    EXPECT_EQ(nothing.mse, 0);
    EXPECT_EQ(nothing.ssim, 1);
}

// The definition, term by term.
double plainSsim(const std::vector<float>& a, const std::vector<float>& b, int width, int height,
                 int px, int py) {
    double window[11][11], total = 0;
    for (int i = 0; i < 11; ++i) {
        for (int j = 0; j < 11; ++j) {
            window[i][j] = std::exp(-((i - 5) * (i - 5) + (j - 5) * (j - 5)) / 4.5);
            total += window[i][j];
        }
    }
    double result = 0;
    for (int c = 0; c < 3; ++c) {
        double x = 0, y = 0, xx = 0, yy = 0, xy = 0;
        for (int i = -5; i <= 5; ++i) {
            for (int j = -5; j <= 5; ++j) {
                const int u = px + j, v = py + i;
                if (u < 0 || v < 0 || u >= width || v >= height) continue;
                const auto at = size_t(3 * (v * width + u) + c);
                const double w = window[i + 5][j + 5] / total;
                const double p = double(a[at]), q = double(b[at]);
                x += w * p, y += w * q, xx += w * p * p, yy += w * q * q, xy += w * p * q;
            }
        }
        result += (2 * x * y + 1e-4) * (2 * (xy - x * y) + 9e-4) /
                  ((x * x + y * y + 1e-4) * (xx - x * x + yy - y * y + 9e-4)) / 3;
    }
    return result;
}

TEST(Metrics, SsimIsTheDefinition) {
    for (const auto& [width, height] : {std::pair{1, 1}, {13, 7}, {3, 40}, {24, 20}}) {
        const auto count = size_t(width * height);
        const auto a = noise(3 * count, 1), b = noise(3 * count, 2);
        const auto map = ssimMap(a, b, width, height);
        double mean = 0;
        for (int y = 0; y < height; ++y) {
            for (int x = 0; x < width; ++x) {
                const double expected = plainSsim(a, b, width, height, x, y);
                EXPECT_NEAR(map[size_t(y * width + x)], expected, 1e-9);
                mean += expected / double(count);
            }
        }
        EXPECT_NEAR(comparePictures(a, b, width, height).ssim, mean, 1e-9);
    }
}

TEST(Metrics, FramesAndJson) {
    const int width = 12, height = 9;
    const auto a = noise(12 * 9 * 3, 3);
    auto b = a;
    std::vector<uint8_t> mask(12 * 9, 0), silhouette = mask;
    for (size_t p = 30; p < 50; ++p) mask[p] = 255;
    for (size_t p = 30; p < 40; ++p) silhouette[p] = 255;
    for (size_t i = 90; i < 150; ++i) b[i] = 1 - b[i];
    const FrameMetrics one = measureFrame("one", a, b, silhouette, mask, width, height);
    const FrameMetrics two = measureFrame("two", a, a, mask, mask, width, height);
    EXPECT_DOUBLE_EQ(one.iou, .5);
    EXPECT_LT(one.psnrBody, one.psnrFrame);
    EXPECT_LT(one.ssimBody, one.ssimFrame);
    const auto whole = comparePictures(a, b, width, height);
    EXPECT_EQ(one.mseFrame, whole.mse);

    const std::vector<FrameMetrics> frames{one, two};
    EXPECT_DOUBLE_EQ(meanMetrics(frames).iou, .75);
    const auto json =
        nlohmann::ordered_json::parse(metricsJson(frames, {{"poses", "as given"}}, true));
    std::vector<std::string> keys;
    for (const auto& [key, value] : json.items()) keys.push_back(key);
    EXPECT_EQ(keys,
              (std::vector<std::string>{"frames", "iou", "psnr_body", "psnr_frame", "ssim_body",
                                        "ssim_frame", "mse_frame", "settings", "per_frame"}));
    EXPECT_EQ(json["frames"], 2);
    EXPECT_EQ(json["settings"]["poses"], "as given");
    EXPECT_DOUBLE_EQ(json["iou"], .75);
    EXPECT_DOUBLE_EQ(json["mse_frame"], one.mseFrame / 2);
    EXPECT_EQ(json["per_frame"][1]["name"], "two");
    const auto plain = nlohmann::json::parse(metricsJson(frames, {}));
    EXPECT_FALSE(plain.contains("per_frame"));
    EXPECT_FALSE(plain.contains("remarks"));
    // Every remark, and names that are not UTF-8.
    std::vector<FrameMetrics> named = frames;
    named[0].name = "caf\xe9";
    const auto remarked = nlohmann::json::parse(
        metricsJson(named, {}, true, {}, {"LPIPS was left out", "FVD was left out"}));
    EXPECT_EQ(remarked["remarks"].size(), 2u);
    EXPECT_EQ(remarked["remarks"][0], "LPIPS was left out");
    EXPECT_EQ(remarked["per_frame"][0]["name"], "caf\xef\xbf\xbd");
}

}  // namespace
}  // namespace doppel
