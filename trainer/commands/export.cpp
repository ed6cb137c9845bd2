#include "trainer/commands/export.h"

#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "trainer/avatar/export.h"
#include "trainer/avatar/formats/model_files.h"
#include "trainer/commands/command.h"
#include "trainer/commands/manual/choices.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"

namespace doppel {

void runExport(const ExportOptions& options) {
    // Formats' endings are those of what avatars and captures are made of: poses.npz.
    requireApart(options.out, {options.avatar, options.motion});
    for (const auto& companion : companionsOf(options.out))
        requireApart(companion, {options.avatar, options.motion});
    Avatar avatar = readAvatar(options.avatar);
    TextureKind texture = textureKind(options.texture);
    if (texture == TextureKind::Refined)
        throwInput(
            "--texture: expected baked, coarse or best, found refined, which is different for "
            "every view");
    if (!isMotionFile(options.out)) requireTexture(avatar, texture, options.avatar);
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
    exportAvatar(device, avatar, options.out, motion ? &*motion : nullptr,
                 {texture, jointNamesByWord(options.names, "--names"), options.shapes,
                  options.author, options.licence});

    size_t keys = motion ? motion->size() : 0;
    if (isMotionFile(options.out)) {
        if (options.common.json)
            printJson(nlohmann::ordered_json{{"out", options.out.string()},
                                             {"joints", BodyModel::kJoints},
                                             {"frames", keys},
                                             {"fps", motion->fps}});
        else
            fmt::print("{}: {} frames of {}, {:.4g} a second\n", options.out.string(), keys,
                       motion->name, motion->fps);
        return;
    }
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
    flags
        .path(
            "--out", o.out,
            "FILE.glb, .vrm (VRM 1.0), .usda (with FILE.png beside it) or .obj (with FILE.mtl and "
            "FILE.png); or the motion alone: .bvh, .npz (AMASS's) or .json")
        ->required();
    flags.path("--motion", o.motion,
               "A capture, a poses.npz, BVH, glTF, AMASS or an estimator's poses, which becomes an "
               "animation");
    flags.frames(o.frames, "Frames of the motion");
    flags
        ->add_option("--texture", o.texture,
                     "baked (the refined textures of many views in one), coarse, or best: baked "
                     "where there is one")
        ->capture_default_str()
        ->check(showsChoices({"baked", "coarse", "best"}));
    flags->add_option("--names", o.names, "What joints are called, but in .obj and .npz")
        ->capture_default_str()
        ->check(showsChoices({"smpl", "vrm", "mixamo", "unreal"}));
    flags->add_flag("--shapes", o.shapes,
                    "Of .glb and .vrm: a morph target for each shape coefficient");
    flags->add_option("--author", o.author, "Of a .vrm: whose avatar it is");
    flags->add_option("--licence", o.licence,
                      "Of a .vrm: address of a licence; VRM's own says that only the author wears "
                      "it");
}

void checkName(ExportOptions& options) {
    if (!isExportName(options.out))
        throwInput(
            "--out: expected a name that ends in .glb, .vrm, .usda, .obj, .bvh, .npz or .json, "
            "found \"{}\"",
            options.out.string());
    if (isMotionFile(options.out) && options.motion.empty())
        throwInput("--motion: expected one for {}, which is a motion's file, found none",
                   options.out.string());
    jointNamesByWord(options.names, "--names");
}

const Command<ExportOptions> kExport{{
    .name = "export",
    .place = 80,
    .summary =
        "Write the avatar for other programs, as glTF, VRM, USD, OBJ; or a motion on its bones",
    .description =
        "Writes a skinned mesh with 24 joints and one texture for all views, and a motion as an\n"
        "animation: glTF (.glb), VRM 1.0 (.vrm), USD (.usda); or one pose as OBJ. A motion alone,\n"
        "on the avatar's skeleton, goes to BVH, AMASS's npz or JSON.",
    .example = "doppel export avatar --out avatar.glb --motion capture",
    .flags = declareFlags,
    .check = checkName,
    .run = runExport,
}};

}  // namespace

}  // namespace doppel
