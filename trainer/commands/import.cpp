#include <fmt/format.h>

#include <iostream>
#include <nlohmann/json.hpp>

#include "engine/device.h"
#include "trainer/avatar/avatar.h"
#include "trainer/commands/commands.h"
#include "trainer/data/body_render.h"
#include "trainer/data/progress.h"
#include "trainer/import/import.h"

namespace doppel {

void runImport(const ImportOptions& options) {
    catchInterrupts();
    requireApart(options.out, {options.source, bodyFile(options.body)});
    const BodyModel body = bodyFromNpz(readBodyArrays(options.body));
    Device device(options.common.deviceOptions());
    BodyPoser poser(device, body);
    MeshDrawer drawer(device, body);
    const ImportResult result = importCapture(options, [&](const Camera& camera, const Theta& theta,
                                                           const Trans& trans, const Betas& betas) {
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
        nlohmann::ordered_json json{{"out", options.out.string()},
                                    {"layout", result.layout},
                                    {"frames", capture.size()},
                                    {"masks_given", result.givenMasks},
                                    {"masks_keyed", result.keyedMasks}};
        if (capture.keypoints) json["keypoints"] = capture.keypoints->scheme;
        if (masks > 0) json["iou"] = result.meanIou;
        std::cout << json.dump(2) << "\n";
        return;
    }
    const Camera& camera = capture.frames[0].camera;
    std::cout << fmt::format("{}: {} frames of {}×{} from the layout {}\n", options.out.string(),
                             capture.size(), camera.width, camera.height, result.layout);
    if (masks > 0) {
        std::cout << fmt::format(
            "masks: {} given, {} keyed; IoU of the unfitted body with them {:.3f}\n",
            result.givenMasks, result.keyedMasks, result.meanIou);
    } else {
        std::cout
            << "masks: none; fit and train need them (--key makes them from a green screen)\n";
    }
    if (options.overlays) {
        std::cout << fmt::format("look at {} before going on\n",
                                 (options.out / "overlay.jpg").string());
    }
}

}  // namespace doppel
