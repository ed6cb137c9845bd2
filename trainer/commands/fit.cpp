#include <iostream>
#include <nlohmann/json.hpp>

#include "trainer/avatar/avatar.h"
#include "trainer/commands/command.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/progress.h"
#include "trainer/stages/fit.h"
#include "trainer/stages/surface.h"

namespace doppel {

namespace {

struct FitOptions {
    CommonOptions common;
    std::filesystem::path capture, out, avatar;
    std::string to;  // "masks" or "pictures"
    std::string body, frames;
    Preset preset;
};

// The avatar's own body into the frames, nothing of the avatar changes: by masks, and by colours
// as well where asked.
FitResult fitAvatar(const FitOptions& options, Capture& capture) {
    const Avatar avatar = readAvatar(options.avatar);
    if (options.to == "pictures") requireTexture(avatar, TextureKind::Coarse, options.avatar);
    Device device(options.common.deviceOptions());
    Capture given = capture;
    given.betas = avatar.betas;
    fitPosesToMasks(device, avatar, capture, options.common.seed);
    if (options.to == "pictures") fitPosesToPictures(device, avatar, capture, options.common.seed);
    FrameCache frames(capture);
    return fitResult(device, avatar.body, given, capture, frames);
}

FitResult fitBody(const FitOptions& options, Capture& capture) {
    const BodyModel body = bodyFromNpz(readBodyArrays(options.body));
    Device device(options.common.deviceOptions());
    return fitCapture(device, body, capture,
                      {.preset = options.preset.fit, .loop = {.seed = options.common.seed}});
}

void runFit(const FitOptions& options) {
    catchInterrupts();
    requireApart(options.out, {options.capture,
                               options.avatar.empty() ? bodyFile(options.body) : options.avatar});
    Capture capture = readCapture(options.capture);
    capture = capture.subset(selectFrames(options.frames, capture.size()));
    capture.requireMasks();
    CaptureWriter writer(options.out);  // refused now rather than after the work
    const FitResult result =
        options.avatar.empty() ? fitBody(options, capture) : fitAvatar(options, capture);
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
    CLI::Option* avatar =
        flags.path("--avatar", o.avatar,
                   "Fit this avatar's own body, which stays as it is, in place of a body model");
    flags
        ->add_option("--to", o.to,
                     "With --avatar: by the masks alone, or by the pictures' colours as well, "
                     "where it is the avatar's person in the same clothes")
        ->check(CLI::IsMember({"masks", "pictures"}))
        ->default_val("pictures")
        ->needs(avatar);
    flags.body(o.body);
    flags.preset("small");
    for (const char* own : {"--body", "--preset", "--set"}) avatar->excludes(own);
}

const Command<FitOptions> kFit{{
    .name = "fit",
    .place = 30,
    .summary = "Refine shape, poses and positions until the body fills the masks",
    .example = "doppel fit capture --out fitted\n"
               "  doppel fit capture --avatar avatar --out reenacted",
    .flags = declareFlags,
    .run = runFit,
}};

}  // namespace

}  // namespace doppel
