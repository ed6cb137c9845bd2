#include "trainer/commands/export.h"

#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "trainer/avatar/export.h"
#include "trainer/commands/command.h"
#include "trainer/data/frame_selection.h"
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
        if (const std::string taken = takenAs(*motion); !taken.empty())
            fmt::print(stderr, "{}: {}\n", options.motion.string(), taken);
        motion = motion->subset(selectFrames(options.frames, motion->size()));
    } else if (!options.frames.empty()) {
        throwInput("--frames: found \"{}\" without --motion; say whose frames they are",
                   options.frames);
    }
    Device device(options.common.deviceOptions());
    exportAvatar(device, avatar, options.out, motion ? &*motion : nullptr, texture);

    size_t keys = motion ? motion->size() : 0;
    if (options.common.json)
        printJson(nlohmann::ordered_json{{"out", options.out.string()},
                                         {"triangles", avatar.body.faceCount},
                                         {"joints", BodyModel::kJoints},
                                         {"texture_size", avatar.textureSize},
                                         {"animation_frames", keys}});
    else if (motion)
        fmt::print("{}: {} triangles, {} frames of {}\n", options.out.string(),
                   avatar.body.faceCount, keys, motion->name);
    else
        fmt::print("{}: {} triangles\n", options.out.string(), avatar.body.faceCount);
}

namespace {

void declareFlags(CommandFlags& flags, ExportOptions& o) {
    flags.precision();
    flags.path("AVATAR", o.avatar, "Avatar's folder")->required();
    flags.path("--out", o.out, "FILE.glb")->required();
    flags.path("--motion", o.motion,
               "A capture, a poses.npz, BVH, glTF, AMASS or an estimator's poses, which becomes an "
               "animation");
    flags.frames(o.frames, "Frames of the motion");
    flags
        ->add_option("--texture", o.texture,
                     "baked (the refined textures of many views in one), coarse, or best: baked "
                     "where there is one")
        ->capture_default_str();
}

void checkName(ExportOptions& options) {
    if (options.out.extension() != ".glb") {
        throwInput("--out: expected a name that ends in .glb, found \"{}\"", options.out.string());
    }
}

const Command<ExportOptions> kExport{{
    .name = "export",
    .place = 80,
    .summary = "Write the avatar as glTF: skinned mesh, texture, animation",
    .example = "doppel export avatar --out avatar.glb --motion capture",
    .flags = declareFlags,
    .check = checkName,
    .run = runExport,
}};

}  // namespace

}  // namespace doppel
