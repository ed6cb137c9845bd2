#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "trainer/commands.h"
#include "trainer/export.h"

namespace doppel {

void runExport(const ExportOptions& options) {
    Avatar avatar = readAvatar(options.avatar);
    if (avatar.texture.empty())
        throwInput("{}: it has no texture yet; train stage texture first", options.avatar.string());
    std::optional<Motion> motion;
    if (!options.motion.empty()) {
        motion = readMotion(options.motion);
        motion = motion->subset(selectFrames(options.frames, motion->size()));
    } else if (!options.frames.empty()) {
        throwInput("--frames: found \"{}\" without --motion; say whose frames they are",
                   options.frames);
    }
    Device device({.name = options.common.device});
    exportAvatar(device, avatar, options.out, motion ? &*motion : nullptr);

    size_t keys = motion ? motion->size() : 0;
    if (options.common.json)
        std::cout << nlohmann::ordered_json{{"out", options.out.string()},
                                            {"triangles", avatar.body.faceCount},
                                            {"joints", BodyModel::kJoints},
                                            {"texture_size", avatar.textureSize},
                                            {"animation_frames", keys}}
                         .dump(2)
                  << "\n";
    else if (motion)
        fmt::print("{}: {} triangles, {} frames of {}\n", options.out.string(),
                   avatar.body.faceCount, keys, motion->name);
    else
        fmt::print("{}: {} triangles\n", options.out.string(), avatar.body.faceCount);
}

}  // namespace doppel
