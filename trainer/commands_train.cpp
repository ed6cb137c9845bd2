#include <iostream>
#include <nlohmann/json.hpp>

#include "trainer/commands.h"
#include "trainer/train.h"

namespace doppel {

void runTrain(const TrainOptions& options) {
    Capture capture = readCapture(options.capture);
    capture = capture.subset(selectFrames(options.frames, capture.size()));
    capture.requireMasks();

    // Stages build on what is there: training the texture alone takes the avatar's own body.
    Avatar avatar;
    bool goesOn = std::filesystem::exists(options.out / "avatar.toml");
    bool first = options.stages.front() == "fit" || !goesOn;
    if (goesOn && (!first || options.resume)) {
        avatar = readAvatar(options.out);
        avatar.preset = options.preset;
    } else {
        avatar.bodyArrays = readBodyArrays(options.body);
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        avatar.preset = options.preset;
        avatar.betas = capture.betas;
    }
    avatar.provenance["capture"] = capture.name;
    avatar.provenance["command"] = options.common.commandLine;
    avatar.provenance["seed"] = fmt::format("{}", options.common.seed);

    Device device({.name = options.common.device});
    TrainSettings settings;
    settings.stages = options.stages;
    settings.out = options.out;
    settings.seed = options.common.seed;
    settings.resume = options.resume;
    settings.pictureSeconds = options.pictureSeconds;
    settings.memoryBudget = options.memoryBudget;
    settings.profileSteps = options.profileSteps;
    TrainResult result = trainAvatar(device, std::move(avatar), std::move(capture), settings);
    if (settings.profileSteps > 0) return;
    if (options.common.json) {
        nlohmann::ordered_json json{{"avatar", options.out.string()}};
        if (result.fit) {
            json["iou_before"] = result.fit->iouBefore;
            json["iou_after"] = result.fit->iouAfter;
        }
        std::cout << json.dump(2) << "\n";
        return;
    }
    if (result.fit)
        fmt::print("silhouette IoU {:.3f} as given, {:.3f} fitted\n", result.fit->iouBefore,
                   result.fit->iouAfter);
    fmt::print("avatar in {}\n", options.out.string());
}

}  // namespace doppel
