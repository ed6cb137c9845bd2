#include "trainer/evaluate.h"

#include <algorithm>

#include "engine/io/image.h"
#include "trainer/background.h"
#include "trainer/output_folder.h"
#include "trainer/progress.h"
#include "trainer/sheet.h"

namespace doppel {

namespace {

// Samples per pixel and axis of an evaluated render: photographs are not aliased either.
constexpr int kSamples = 2;

}  // namespace

std::vector<FrameMetrics> evaluateAvatar(Device& device, const Avatar& avatar,
                                         const Capture& capture,
                                         const std::filesystem::path& pictures,
                                         TextureKind texture) {
    capture.requireMasks();
    if (!pictures.empty()) createFolders(pictures);
    FrameCache frames(capture);
    BackgroundPlate plate(capture, frames);
    AvatarRenderer renderer(device, avatar, true, texture);
    Progress progress("eval", static_cast<int64_t>(capture.size()));
    std::vector<FrameMetrics> metrics;
    for (size_t i = 0; i < capture.size(); ++i) {
        if (interrupted()) throw Interrupted{};
        const Frame& frame = capture.frames[i];
        auto picture = frames.load(i);
        int w = frame.camera.width, h = frame.camera.height;
        Drawing drawing = renderer.draw(capture.theta[i], capture.trans[i], frame.camera, kSamples);
        std::vector<float> render = composite(drawing.rgb, drawing.mask, plate.behind(*picture));
        std::vector<float> target(picture->rgb.size());
        std::ranges::transform(picture->rgb, target.begin(),
                               [](uint8_t b) { return static_cast<float>(b) / 255.0f; });
        std::vector<uint8_t> silhouette = drawing.mask;
        for (uint8_t& value : silhouette) value = value >= 128 ? 255 : 0;
        metrics.push_back(
            measureFrame(frame.name, render, target, silhouette, picture->mask, w, h));
        if (!pictures.empty())
            writeImage(pictures / (frame.name + ".png"),
                       contactSheet({{toImage(target, w, h), toImage(render, w, h),
                                      differenceImage(target, render, w, h, 4)}}));
        progress.update(static_cast<int64_t>(i) + 1,
                        {{"iou", metrics.back().iou}, {"psnr", metrics.back().psnrBody}});
    }
    return metrics;
}

std::vector<double> avatarIous(Device& device, const Avatar& avatar, const Capture& capture,
                               bool refined) {
    capture.requireMasks();
    FrameCache frames(capture);
    AvatarRenderer renderer(device, avatar, refined);
    std::vector<double> ious;
    for (size_t i = 0; i < capture.size(); ++i)
        ious.push_back(intersectionOverUnion(
            renderer.mask(capture.theta[i], capture.trans[i], capture.frames[i].camera),
            frames.load(i)->mask));
    return ious;
}

}  // namespace doppel
