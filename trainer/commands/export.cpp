#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "trainer/avatar/export.h"
#include "trainer/commands/commands.h"
#include "trainer/data/output_folder.h"

namespace doppel {

void runExport(const ExportOptions& options) {
    requireFileApart(options.out, {options.avatar, options.motion});
    Avatar avatar = readAvatar(options.avatar);
    TextureKind texture = textureKind(options.texture);
    if (texture == TextureKind::Refined)
        throwInput(
            "--texture: expected baked, coarse or best, found refined, which is different for "
            "every view");
    requireTexture(avatar, texture, options.avatar);
    std::optional<Motion> motion;
    if (!options.motion.empty()) {
        motion = readMotion(options.motion);
        motion = motion->subset(selectFrames(options.frames, motion->size()));
    } else if (!options.frames.empty()) {
        throwInput("--frames: found \"{}\" without --motion; say whose frames they are",
                   options.frames);
    }
    Device device(options.common.deviceOptions());
    exportAvatar(device, avatar, options.out, motion ? &*motion : nullptr, texture);

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
