#include <iostream>

#include "trainer/commands.h"
#include "trainer/evaluate.h"
#include "trainer/stage_fit.h"

namespace doppel {

void runEval(const EvalOptions& options) {
    Avatar avatar = readAvatar(options.avatar);
    Capture capture = readCapture(options.capture);
    capture = capture.subset(selectFrames(options.frames, capture.size()));
    capture.requireMasks();
    TextureKind texture = textureKind(options.texture);
    requireTexture(avatar, texture, options.avatar);
    Device device({.name = options.common.device});
    std::vector<std::pair<std::string, std::string>> settings{
        {"avatar", options.avatar.string()},
        {"capture", options.capture.string()},
        {"frames", options.frames.empty() ? "all" : options.frames},
        {"fit_test_poses", options.fitTestPoses ? "true" : "false"},
        {"preset", avatar.preset.name},
        {"texture", options.texture},
        {"seed", fmt::format("{}", options.common.seed)},
        {"background", "the frame's own pixels away from the mask, the median over time behind it"},
        {"device", device.info().name}};
    if (options.fitTestPoses) {
        capture.betas = avatar.betas;
        FitResult fit = fitCapture(
            device, avatar.body, capture,
            {.preset = avatar.preset.fit, .fitShape = false, .loop = {.seed = options.common.seed}});
        settings.emplace_back("body_iou_before_fit", fmt::format("{:.4f}", fit.iouBefore));
        settings.emplace_back("body_iou_after_fit", fmt::format("{:.4f}", fit.iouAfter));
    }
    std::vector<FrameMetrics> metrics = evaluateAvatar(device, avatar, capture, options.pictures, texture);
    if (options.common.json) {
        std::cout << metricsJson(metrics, settings, true) << "\n";
        return;
    }
    FrameMetrics mean = meanMetrics(metrics);
    fmt::print("{} frames, poses {}\n", metrics.size(),
               options.fitTestPoses ? "fitted to their masks" : "as given");
    fmt::print("  silhouette IoU  {:.3f}\n", mean.iou);
    fmt::print("  PSNR            {:.2f} dB over the body, {:.2f} dB over the frame\n",
               mean.psnrBody, mean.psnrFrame);
    fmt::print("  SSIM            {:.3f} over the body, {:.3f} over the frame\n", mean.ssimBody,
               mean.ssimFrame);
    fmt::print("  MSE             {:.1f} over the frame (8-bit units)\n", mean.mseFrame);
}

}  // namespace doppel
