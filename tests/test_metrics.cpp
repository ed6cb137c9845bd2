#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "engine/files/npz.h"
#include "trainer/eval/metrics.h"
#include "trainer/eval/picture_figures.h"

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
    const std::vector<uint8_t> none(13 * 7, 0);
    const auto same = measureFrame("", a, b, none, none, width, height);
    EXPECT_EQ(same.mseFrame, 0);
    EXPECT_EQ(same.psnrFrame, 99);
    EXPECT_NEAR(same.ssimFrame, 1, 1e-12);

    for (float& value : b) value += .1f;
    const auto off = measureFrame("", a, b, none, none, width, height);
    EXPECT_NEAR(off.mseFrame, 25.5 * 25.5, 1e-3);
    EXPECT_NEAR(off.psnrFrame, 20, 1e-5);
    EXPECT_EQ(off.psnrBody, 99);  // there is nobody
    EXPECT_EQ(off.ssimBody, 1);

    // Only what the mask shows.
    b = a;
    std::vector<uint8_t> mask(13 * 7, 0);
    mask[20] = 255, mask[21] = 1;
    b[60] = .8f;  // pixel 20, red
    b[0] = 0;     // outside
    const auto masked = measureFrame("", a, b, mask, mask, width, height);
    EXPECT_NEAR(masked.psnrBody, -10 * std::log10(.3 * .3 / 6), 1e-5);
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
        const std::vector<uint8_t> none(count, 0);
        EXPECT_NEAR(measureFrame("", a, b, none, none, width, height).ssimFrame, mean, 1e-9);
    }
}

// A box of the frame against boxes that are shifted, smaller, blurred.
TEST(PictureFigures, TellWhatIsWrong) {
    constexpr int kSize = 40;
    auto boxMask = [](int x0, int x1) {
        std::vector<uint8_t> mask(kSize * kSize);
        for (int y = 10; y < 30; ++y)
            for (int x = x0; x < x1; ++x) mask[size_t(y * kSize + x)] = 255;
        return mask;
    };
    auto picture = [](const std::vector<uint8_t>& mask, int shift, bool flat) {
        std::vector<float> rgb;
        for (int i = 0; i < kSize * kSize; ++i) {
            const int x = i % kSize - shift, y = i / kSize;
            const float wave = flat ? .5f : .5f + .4f * std::sin(.9f * float(x) + .7f * float(y));
            rgb.insert(rgb.end(), 3, mask[size_t(i)] ? wave : .2f);
        }
        return rgb;
    };
    auto cut = [](std::vector<float> rgb, const std::vector<uint8_t>& mask) {
        for (size_t i = 0; i < rgb.size(); ++i)
            if (!mask[i / 3]) rgb[i] = 0;
        return rgb;
    };
    const std::vector<uint8_t> mask = boxMask(10, 30), thin = boxMask(11, 29);
    const std::vector<float> frame = picture(mask, 0, false);
    auto figures = [&](const std::vector<float>& render, const std::vector<uint8_t>& coverage) {
        const std::vector<float> person = cut(render, coverage);
        const Figures all = pictureFigures({kSize,
                                            kSize,
                                            render,
                                            frame,
                                            person,
                                            coverage,
                                            mask,
                                            {regionOf("head", {10, 10, 30, 30}, kSize, kSize)}});
        std::map<std::string, double> map(all.begin(), all.end());
        EXPECT_EQ(map.size(), all.size());
        return map;
    };
    auto same = figures(frame, mask);
    for (const char* name : {"psnr_union", "psnr_interior", "psnr_white", "psnr_head"})
        EXPECT_EQ(same[name], 99) << name;
    for (const char* name : {"sharpness_interior", "sharpness_head", "ssim_head", "similarity_head",
                             "correlation_head"})
        EXPECT_NEAR(same[name], 1, 1e-9) << name;
    EXPECT_EQ(same["outline_bias"], 0);
    EXPECT_EQ(same["outline_95"], 0);

    auto thinner = figures(picture(thin, 0, false), thin);
    EXPECT_NEAR(thinner["outline_bias"], 40.0 / 76, 1e-9);  // two columns of 20 over the rim
    EXPECT_EQ(thinner["outline_95"], 1);
    EXPECT_GT(thinner["psnr_interior"], 60);
    EXPECT_LT(thinner["psnr_white"], 30);

    auto flat = figures(picture(mask, 0, true), mask);
    EXPECT_LT(flat["sharpness_interior"], .1);
    EXPECT_LT(flat["similarity_head"], .9);
    // Two pixels to the side: as sharp, and found again by the correlation alone.
    auto shifted = figures(picture(mask, 2, false), mask);
    EXPECT_NEAR(shifted["sharpness_head"], 1, .1);
    EXPECT_LT(shifted["psnr_head"], 15);
    EXPECT_GT(shifted["correlation_head"], .95);
    // A head out of the picture has no figures.
    const Figures none = pictureFigures(
        {kSize, kSize, frame, frame, frame, mask, mask, {regionOf("head", {}, kSize, kSize)}});
    EXPECT_EQ(none.back().first, "psnr_white");
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

    const std::vector<FrameMetrics> frames{one, two};
    EXPECT_DOUBLE_EQ(meanMetrics(frames).iou, .75);
    std::vector<FrameMetrics> figured = frames;
    figured[0].figures = {{"outline_bias", 1}, {"psnr_head", 20}};
    figured[1].figures = {{"outline_bias", 2}};  // its head is out of the picture
    EXPECT_EQ(meanMetrics(figured).figures, (std::vector<std::pair<std::string, double>>{
                                                {"outline_bias", 1.5}, {"psnr_head", 20}}));
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
