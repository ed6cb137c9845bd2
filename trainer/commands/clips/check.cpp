// `doppel check`: a capture against what is known of its clip.
#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "trainer/avatar/avatar.h"
#include "trainer/commands/command.h"
#include "trainer/eval/clip_truth.h"

namespace doppel {

namespace {

struct CheckOptions {
    CommonOptions common;
    std::filesystem::path capture, truth;
    std::string body;
};

void runCheck(const CheckOptions& options) {
    const BodyModel body = bodyFromNpz(readBodyArrays(options.body));
    const Capture capture = readCapture(options.capture);
    const ClipTruth truth = readClipTruth(options.truth, body);
    const std::vector<FrameError> errors = compareWithTruth(capture, truth, body);
    FrameError mean;
    double masks = 0, iou = 0;
    for (const FrameError& e : errors) {
        mean.joints += e.joints / double(errors.size());
        mean.aligned += e.aligned / double(errors.size());
        mean.pelvis += e.pelvis / double(errors.size());
        if (e.iou) iou += *e.iou, ++masks;
    }
    if (masks > 0) mean.iou = iou / masks;
    const FrameError& farthest = *std::ranges::max_element(errors, {}, &FrameError::joints);
    const FrameError& worst = *std::ranges::min_element(
        errors, {}, [](const FrameError& e) { return e.iou.value_or(2); });
    if (options.common.json) {
        using Json = nlohmann::ordered_json;
        const auto object = [](const FrameError& e) {
            Json json{{"joints_mm", e.joints}, {"aligned_mm", e.aligned}, {"pelvis_mm", e.pelvis}};
            json["mask_iou"] = e.iou ? Json(*e.iou) : Json();
            return json;
        };
        Json json = object(mean);
        json["frames"] = errors.size();
        for (const FrameError& e : errors) json["per_frame"][e.name] = object(e);
        printJson(json);
        return;
    }
    fmt::print("{}: {} of {} frames are in {}\n", options.capture.string(), errors.size(),
               capture.size(), options.truth.string());
    fmt::print(
        "  joints   {:.1f} mm off, pelvis on pelvis; {:.1f} mm turned and scaled to it; "
        "worst {:.1f} mm in {}\n",
        mean.joints, mean.aligned, farthest.joints, farthest.name);
    fmt::print("  pelvis   {:.0f} mm off\n", mean.pelvis);
    if (mean.iou)
        fmt::print("  masks    IoU {:.3f}; worst {:.3f} in {}\n", *mean.iou, *worst.iou,
                   worst.name);
}

void declareFlags(CommandFlags& flags, CheckOptions& o) {
    flags.path("CAPTURE", o.capture, "Capture of a clip, as imported or fitted")->required();
    flags.path("TRUTH", o.truth, "Folder with masks/ and poses.npz: a truth, or another capture")
        ->required();
    flags.body(o.body);
}

const Command<CheckOptions> kCheck{{
    .name = "check",
    .place = 65,
    .summary = "Compare a capture's poses and masks with the truth",
    .description =
        "Compares the poses and masks of a capture with what is known of its clip, frame by frame\n"
        "by their names: of a synthetic clip (`doppel demo --clip`), or of another recording of "
        "the\nsame. Joints are shoulders, elbows, wrists, hips, knees and ankles.",
    .example = "doppel check capture out/demo/truth",
    .flags = declareFlags,
    .run = runCheck,
}};

}  // namespace

}  // namespace doppel
