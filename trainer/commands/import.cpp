#include "trainer/commands/import.h"

#include <fmt/format.h>

#include <iostream>
#include <nlohmann/json.hpp>

#include "engine/device.h"
#include "trainer/avatar/avatar.h"
#include "trainer/commands/command.h"
#include "trainer/data/body_render.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/import/import.h"

namespace doppel {

void runImport(const ImportOptions& options) {
    catchInterrupts();
    requireApart(options.settings.out, {options.settings.request.source, bodyFile(options.body)});
    const BodyModel body = bodyFromNpz(readBodyArrays(options.body));
    Device device(options.common.deviceOptions());
    BodyPoser poser(device, body);
    MeshDrawer drawer(device, body);
    const ImportResult result = importCapture(
        options.settings,
        [&](const Camera& camera, const Theta& theta, const Trans& trans, const Betas& betas) {
            Drawing drawing = drawer.drawShaded(poser.pose(theta, trans, betas).verts, camera);
            BodyPicture picture{std::move(drawing.mask), {}};
            // Shades of grey: one channel tells all.
            for (size_t i = 0; i < drawing.rgb.size(); i += 3) {
                picture.shade.push_back(drawing.rgb[i]);
            }
            return picture;
        });

    const Capture& capture = result.capture;
    const size_t masks = result.givenMasks + result.keyedMasks;
    if (options.common.json) {
        nlohmann::ordered_json json{{"out", options.settings.out.string()},
                                    {"layout", result.layout},
                                    {"frames", capture.size()},
                                    {"masks_given", result.givenMasks},
                                    {"masks_keyed", result.keyedMasks}};
        if (capture.keypoints) json["keypoints"] = capture.keypoints->scheme;
        if (masks > 0) json["iou"] = result.meanIou;
        printJson(json);
        return;
    }
    const Camera& camera = capture.frames[0].camera;
    std::cout << fmt::format("{}: {} frames of {}×{} from the layout {}\n",
                             options.settings.out.string(), capture.size(), camera.width,
                             camera.height, result.layout);
    if (masks > 0) {
        std::cout << fmt::format(
            "masks: {} given, {} keyed; IoU of the unfitted body with them {:.3f}\n",
            result.givenMasks, result.keyedMasks, result.meanIou);
    } else {
        std::cout
            << "masks: none; fit and train need them (--key makes them from a green screen)\n";
    }
    if (options.settings.overlays) {
        std::cout << fmt::format("look at {} before going on\n",
                                 (options.settings.out / "overlay.jpg").string());
    }
}

namespace {

void declareFlags(CommandFlags& flags, ImportOptions& o) {
    flags.path("SRC", o.settings.request.source, "Folder to read")->required();
    flags.path("--out", o.settings.out, "Capture to write")->required();
    flags->add_flag("--key", o.settings.request.key,
                    "Make masks from a green screen for frames that have none");
    flags->add_option("--fps", o.settings.request.fps, "Frames per second of the recording")
        ->capture_default_str()
        ->check(CLI::Range(.01, 1000.));
    flags.frames(o.settings.request.frames, "Frames to take");
    flags.body(o.body);
    flags->add_flag("!--no-overlays", o.settings.overlays, "Leave the overlay pictures out");
}

const Command<ImportOptions> kImport{{
    .name = "import",
    .place = 20,
    .summary = "Bring another program's layout into a capture",
    .description =
        "Brings another program's layout into a capture. The layout is detected: the Human\n"
        "Retargeting dataset's (images/, smpl_pose/*_body.pkl, segmentations/ if there are "
        "any),\nor a capture of Doppel's own. Draws the given pose over each frame "
        "(overlay.jpg, overlays/).",
    .example = "doppel import retargeting/box --out box --key",
    .flags = declareFlags,
    .run = runImport,
}};

}  // namespace

}  // namespace doppel
