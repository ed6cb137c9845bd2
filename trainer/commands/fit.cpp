#include <iostream>
#include <nlohmann/json.hpp>

#include "trainer/avatar/avatar.h"
#include "trainer/commands/commands.h"
#include "trainer/data/progress.h"
#include "trainer/stages/fit.h"

namespace doppel {

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
        std::cout << json.dump(2) << "\n";
        return;
    }
    fmt::print("{} frames; silhouette IoU {:.3f} as given, {:.3f} fitted\n", capture.size(),
               result.iouBefore, result.iouAfter);
    for (size_t i = 0; i < capture.size(); ++i)
        fmt::print("  {:<32} {:.3f}  {:.3f}\n", capture.frames[i].name, result.frameIouBefore[i],
                   result.frameIouAfter[i]);
}

}  // namespace doppel
