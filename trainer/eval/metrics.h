// Figures that compare renders with frames, on the host in double precision.
//
// Colours are sRGB-encoded values in [0,1]; MSE is in 8-bit units (255² per unit), PSNR is
// 10 log10(1 / mse of [0,1] values). SSIM: 11×11 Gaussian window, σ 1.5, K1 .01, K2 .03, zero
// padding, as the op `ssim`; per channel, then the mean of the channels. The SSIM of the body is
// the mean of the whole frame's SSIM map over the body's pixels.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace doppel {

// |a ∧ b| / |a ∨ b| of masks, each [H][W], > 0 inside. 1 where both are empty.
double intersectionOverUnion(std::span<const uint8_t> a, std::span<const uint8_t> b);

// a, b: [H][W][3]. The SSIM map [H][W], mean over the channels.
std::vector<double> ssimMap(std::span<const float> a, std::span<const float> b, int width,
                            int height);

struct FrameMetrics {
    std::string name;
    double iou = 0, psnrBody = 0, psnrFrame = 0, ssimBody = 0, ssimFrame = 0, mseFrame = 0;
    std::optional<double> lpips;  // of the whole frame; nothing where it was not asked for
    std::vector<std::pair<std::string, double>> figures;  // trainer/eval/picture_figures.h
};

// rendered and frame: [H][W][3], the render composited on the capture's background. silhouette and
// mask: [H][W], > 0 the person. The body's region is the mask; an empty one gives PSNR 99, as equal
// pictures do, and SSIM 1.
FrameMetrics measureFrame(std::string name, std::span<const float> rendered,
                          std::span<const float> frame, std::span<const uint8_t> silhouette,
                          std::span<const uint8_t> mask, int width, int height);

// Mean |a - b| over pixels and channels, in 8-bit units. a, b: of the same size, in [0,1].
double meanDifference(std::span<const float> a, std::span<const float> b);

// Means over the frames; LPIPS where every frame has it, each figure over the frames that have it.
FrameMetrics meanMetrics(std::span<const FrameMetrics> frames);

// One object: frames (their number), iou, psnr_body, psnr_frame, ssim_body, ssim_frame, mse_frame,
// lpips and figures where they were measured, `more` (null where there is no figure), settings (the
// given pairs in order, each name once), remarks where there are any, per_frame where asked for.
std::string metricsJson(std::span<const FrameMetrics> frames,
                        const std::vector<std::pair<std::string, std::string>>& settings,
                        bool perFrame = false,
                        const std::vector<std::pair<std::string, std::optional<double>>>& more = {},
                        const std::vector<std::string>& remarks = {});

}  // namespace doppel
