#include "trainer/eval/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kEqualPsnr = 99;
constexpr int kRadius = 5;  // 11 taps

std::array<double, 2 * kRadius + 1> gaussianWindow() {
    std::array<double, 2 * kRadius + 1> window{};
    double sum = 0;
    for (int i = -kRadius; i <= kRadius; ++i) {
        sum += window[size_t(i + kRadius)] = std::exp(-i * i / (2 * 1.5 * 1.5));
    }
    for (double& weight : window) weight /= sum;
    return window;
}

// values: [H][W]; zeros beyond the border.
void blur(std::vector<double>& values, int width, int height, std::vector<double>& scratch) {
    static const auto window = gaussianWindow();
    const auto w = static_cast<size_t>(width);
    scratch.assign(values.size(), 0);
    for (int y = 0; y < height; ++y) {
        const double* row = values.data() + size_t(y) * w;
        double* to = scratch.data() + size_t(y) * w;
        for (int x = 0; x < width; ++x) {
            const int first = std::max(-kRadius, -x), last = std::min(kRadius, width - 1 - x);
            double sum = 0;
            for (int i = first; i <= last; ++i) sum += window[size_t(i + kRadius)] * row[x + i];
            to[x] = sum;
        }
    }
    std::fill(values.begin(), values.end(), 0);
    for (int y = 0; y < height; ++y) {
        double* to = values.data() + size_t(y) * w;
        const int first = std::max(-kRadius, -y), last = std::min(kRadius, height - 1 - y);
        for (int i = first; i <= last; ++i) {
            const double weight = window[size_t(i + kRadius)];
            const double* from = scratch.data() + size_t(y + i) * w;
            for (size_t x = 0; x < w; ++x) to[x] += weight * from[x];
        }
    }
}

double psnrOf(double meanSquare) {
    return meanSquare > 0 ? std::min(kEqualPsnr, 10 * std::log10(1 / meanSquare)) : kEqualPsnr;
}

struct PictureDifference {
    double mse = 0;   // 8-bit units
    double psnr = 0;  // dB; 99 where the pictures are equal
    double ssim = 0;
};

// mask: empty: the whole frame.
PictureDifference compareWithMap(std::span<const float> a, std::span<const float> b,
                                 std::span<const double> map, std::span<const uint8_t> mask) {
    double square = 0, ssim = 0;
    size_t pixels = 0;
    for (size_t p = 0; p < map.size(); ++p) {
        if (!mask.empty() && mask[p] == 0) continue;
        for (size_t c = 0; c < 3; ++c) {
            const double d = double(a[3 * p + c]) - double(b[3 * p + c]);
            square += d * d;
        }
        ssim += map[p];
        ++pixels;
    }
    if (pixels == 0) return {0, kEqualPsnr, 1};
    const double mean = square / (3 * double(pixels));
    return {mean * 255 * 255, psnrOf(mean), ssim / double(pixels)};
}

}  // namespace

double intersectionOverUnion(std::span<const uint8_t> a, std::span<const uint8_t> b) {
    CHECK(a.size() == b.size(), "masks have the same size, not {} and {}", a.size(), b.size());
    size_t both = 0, either = 0;
    for (size_t i = 0; i < a.size(); ++i) {
        both += a[i] > 0 && b[i] > 0;
        either += a[i] > 0 || b[i] > 0;
    }
    return either == 0 ? 1 : double(both) / double(either);
}

std::vector<double> ssimMap(std::span<const float> a, std::span<const float> b, int width,
                            int height) {
    const size_t pixels = size_t(width) * size_t(height);
    CHECK(a.size() == 3 * pixels && b.size() == 3 * pixels, "pictures are [{}][{}][3]", height,
          width);
    constexpr double c1 = .01 * .01, c2 = .03 * .03;
    std::vector<double> map(pixels), meanA(pixels), meanB(pixels), aa(pixels), bb(pixels),
        ab(pixels), scratch;
    for (size_t c = 0; c < 3; ++c) {
        for (size_t p = 0; p < pixels; ++p) {
            const double x = double(a[3 * p + c]), y = double(b[3 * p + c]);
            meanA[p] = x, meanB[p] = y, aa[p] = x * x, bb[p] = y * y, ab[p] = x * y;
        }
        for (auto* values : {&meanA, &meanB, &aa, &bb, &ab}) blur(*values, width, height, scratch);
        for (size_t p = 0; p < pixels; ++p) {
            const double x = meanA[p], y = meanB[p];
            map[p] += (2 * x * y + c1) * (2 * (ab[p] - x * y) + c2) /
                      ((x * x + y * y + c1) * (aa[p] - x * x + bb[p] - y * y + c2)) / 3;
        }
    }
    return map;
}

FrameMetrics measureFrame(std::string name, std::span<const float> rendered,
                          std::span<const float> frame, std::span<const uint8_t> silhouette,
                          std::span<const uint8_t> mask, int width, int height) {
    const std::vector<double> map = ssimMap(rendered, frame, width, height);
    CHECK(mask.size() == map.size(), "the mask is [{}][{}]", height, width);
    const PictureDifference body = compareWithMap(rendered, frame, map, mask);
    const PictureDifference whole = compareWithMap(rendered, frame, map, {});
    return {std::move(name), intersectionOverUnion(silhouette, mask),
            body.psnr,       whole.psnr,
            body.ssim,       whole.ssim,
            whole.mse};
}

double meanDifference(std::span<const float> a, std::span<const float> b) {
    CHECK(a.size() == b.size(), "pictures have the same size, not {} and {}", a.size(), b.size());
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += std::abs(double(a[i]) - double(b[i]));
    return a.empty() ? 0 : 255 * sum / double(a.size());
}

FrameMetrics meanMetrics(std::span<const FrameMetrics> frames) {
    FrameMetrics mean{.name = "mean"};
    if (!frames.empty() &&
        std::ranges::all_of(frames, [](const FrameMetrics& f) { return f.lpips.has_value(); }))
        mean.lpips = 0;
    const double n = std::max<double>(1, double(frames.size()));
    for (const FrameMetrics& f : frames) {
        mean.iou += f.iou / n;
        mean.psnrBody += f.psnrBody / n;
        mean.psnrFrame += f.psnrFrame / n;
        mean.ssimBody += f.ssimBody / n;
        mean.ssimFrame += f.ssimFrame / n;
        mean.mseFrame += f.mseFrame / n;
        if (mean.lpips) *mean.lpips += *f.lpips / n;
    }
    // A head may be out of the picture.
    std::vector<double> counts;
    for (const FrameMetrics& f : frames)
        for (const auto& [name, value] : f.figures) {
            auto there =
                std::ranges::find(mean.figures, name, &std::pair<std::string, double>::first);
            if (there == mean.figures.end()) {
                there = mean.figures.insert(there, {name, 0});
                counts.push_back(0);
            }
            there->second += value;
            counts[static_cast<size_t>(there - mean.figures.begin())] += 1;
        }
    for (size_t i = 0; i < counts.size(); ++i) mean.figures[i].second /= counts[i];
    return mean;
}

std::string metricsJson(std::span<const FrameMetrics> frames,
                        const std::vector<std::pair<std::string, std::string>>& settings,
                        bool perFrame,
                        const std::vector<std::pair<std::string, std::optional<double>>>& more,
                        const std::vector<std::string>& remarks) {
    using Json = nlohmann::ordered_json;
    const auto object = [](const FrameMetrics& m) {
        Json json{{"iou", m.iou},
                  {"psnr_body", m.psnrBody},
                  {"psnr_frame", m.psnrFrame},
                  {"ssim_body", m.ssimBody},
                  {"ssim_frame", m.ssimFrame},
                  {"mse_frame", m.mseFrame}};
        if (m.lpips) json["lpips"] = *m.lpips;
        for (const auto& [name, value] : m.figures) json[name] = value;
        return json;
    };
    Json json{{"frames", frames.size()}};
    json.update(object(meanMetrics(frames)));
    for (const auto& [name, value] : more) json[name] = value ? Json(*value) : Json();
    Json& all = json["settings"] = Json::object();
    for (const auto& [name, value] : settings) all[name] = value;
    if (!remarks.empty()) json["remarks"] = remarks;
    if (perFrame) {
        Json& list = json["per_frame"] = Json::array();
        for (const FrameMetrics& frame : frames) {
            Json entry{{"name", frame.name}};
            entry.update(object(frame));
            list.push_back(std::move(entry));
        }
    }
    return json.dump(2, ' ', false, Json::error_handler_t::replace);
}

}  // namespace doppel
