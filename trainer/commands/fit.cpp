#include <iostream>
#include <nlohmann/json.hpp>

#include "trainer/avatar/avatar.h"
#include "trainer/commands/command.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/progress.h"
#include "trainer/stages/fit.h"

namespace doppel {

namespace {

struct FitOptions {
    CommonOptions common;
    std::filesystem::path capture, out;
    std::string body, frames;
    Preset preset;
};

void runFit(const FitOptions& options) {
    catchInterrupts();
    requireApart(options.out, {options.capture, bodyFile(options.body)});
    Capture capture = readCapture(options.capture);
    capture = capture.subset(selectFrames(options.frames, capture.size()));
    capture.requireMasks();
    CaptureWriter writer(options.out);  // refused now rather than after the work
    BodyModel body = bodyFromNpz(readBodyArrays(options.body));
    Device device(options.common.deviceOptions());
    FitResult result =
        fitCapture(device, body, capture,
                   {.preset = options.preset.fit, .loop = {.seed = options.common.seed}});
    capture.source["fitted_by"] = options.common.commandLine;
    writeCapture(capture, writer);
    if (options.common.json) {
        nlohmann::ordered_json json{{"frames", capture.size()},
                                    {"iou_before", result.iouBefore},
                                    {"iou_after", result.iouAfter},
                                    {"betas", capture.betas}};
        printJson(json);
        return;
    }
    fmt::print("{} frames; silhouette IoU {:.3f} as given, {:.3f} fitted\n", capture.size(),
               result.iouBefore, result.iouAfter);
    for (size_t i = 0; i < capture.size(); ++i)
        fmt::print("  {:<32} {:.3f}  {:.3f}\n", capture.frames[i].name, result.frameIouBefore[i],
                   result.frameIouAfter[i]);
}

void declareFlags(CommandFlags& flags, FitOptions& o) {
    flags.path("CAPTURE", o.capture, "Capture to read; it needs masks")->required();
    flags.path("--out", o.out, "Capture to write")->required();
    flags.frames(o.frames, "Frames to fit and write");
    flags.body(o.body);
    flags.preset("small");
}

const Command<FitOptions> kFit{{
    .name = "fit",
    .place = 30,
    .summary = "Refine shape, poses and positions until the body fills the masks",
    .example = "doppel fit capture --out fitted",
    .flags = declareFlags,
    .run = runFit,
}};

}  // namespace

}  // namespace doppel
