#include "trainer/commands/export.h"

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "engine/error.h"
#include "engine/files/printable.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/formats/model_files.h"
#include "trainer/avatar/formats/network_files.h"
#include "trainer/avatar/formats/web_page.h"
#include "trainer/avatar/rendering.h"
#include "trainer/commands/command.h"
#include "trainer/commands/manual/choices.h"
#include "trainer/data/capture_notes.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/motion/upright.h"

namespace doppel {

namespace {

void exportNetworks(const ExportOptions& options) {
    requireApart(options.networks, {options.avatar});
    const Avatar avatar = readAvatar(options.avatar);
    OutputFolder folder(options.networks, "networks");
    const std::vector<std::string> names = writeNetworks(folder.folder(), avatar);
    if (names.empty())
        throwInput("{}: it has no networks yet; train stage mesh, texture or refine first",
                   options.avatar.string());
    folder.commit();
    if (options.common.json)
        printJson(nlohmann::ordered_json{{"out", options.networks.string()}, {"networks", names}});
    else
        fmt::print("{}: {}, each as .onnx and .safetensors; README.txt lists inputs and tensors\n",
                   options.networks.string(), fmt::join(names, ", "));
}

}  // namespace

void runExport(const ExportOptions& options) {
    if (!options.networks.empty()) {
        exportNetworks(options);
        return;
    }
    const bool isPage = !options.web.empty();
    const std::filesystem::path& place = isPage ? options.web : options.out;
    // Formats' endings are those of what avatars and captures are made of: poses.npz.
    std::vector<std::filesystem::path> inputs{options.avatar, options.retarget.contacts};
    for (const auto& motion : options.motions)
        for (const auto& origin : originsOf(motion)) inputs.push_back(origin);
    requireApart(place, inputs);
    for (const auto& companion : companionsOf(options.out)) requireApart(companion, inputs);
    std::optional<OutputFolder> folder;
    if (isPage) {
        requireWebSources();
        folder.emplace(options.web, "web page");
    }
    const std::filesystem::path out = isPage ? folder->folder() / "avatar.glb" : options.out;
    Avatar avatar = readAvatar(options.avatar);
    TextureKind texture = textureKind(options.texture);
    if (texture == TextureKind::Refined)
        throwInput(
            "--texture: expected baked, coarse or best, found refined, which is different for "
            "every view");
    if (!isMotionFile(out)) requireTexture(avatar, texture, options.avatar);
    std::vector<Motion> motions;
    size_t keys = 0;
    for (const auto& path : options.motions) {
        const Motion read = readMotion(path);
        if (const std::string taken = takenAs(read); !taken.empty())
            fmt::print(stderr, "{}: {}\n", path.string(), taken);
        const Retargeted retargeted = performed(avatar, options.avatar, read, options.retarget);
        if (!retargeted.summary.empty())
            fmt::print(stderr, "{}: {}\n", path.string(), retargeted.summary);
        motions.push_back(retargeted.motion.subset(selectFrames(options.frames, read.size())));
        keys += motions.back().size();
    }
    const Motion* motion = motions.empty() ? nullptr : &motions.front();
    if (!motion && !options.frames.empty()) {
        throwInput("--frames: found \"{}\" without --motion; say whose frames they are",
                   options.frames);
    }
    Device device(options.common.deviceOptions());
    exportAvatar(device, avatar, out, motion,
                 {.texture = texture,
                  .names = jointNamesByWord(options.names, "--names"),
                  .shapes = options.shapes,
                  .author = options.author,
                  .licence = options.licence,
                  .permissions = options.permissions,
                  .lit = options.material == "lit",
                  .furtherMotions = std::span<const Motion>(motions).subspan(motion ? 1 : 0)});
    if (isPage) {
        writeWebPage(folder->folder(), folder->target().filename().string());
        folder->commit();
    }

    if (isMotionFile(out)) {
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
        printJson(nlohmann::ordered_json{{"out", place.string()},
                                         {"triangles", avatar.body.faceCount},
                                         {"joints", BodyModel::kJoints},
                                         {"texture_size", avatar.textureSize},
                                         {"animation_frames", keys}});
    else if (motions.size() > 1)
        fmt::print("{}: {} triangles, {} frames of {} motions\n", place.string(),
                   avatar.body.faceCount, keys, motions.size());
    else if (motion)
        fmt::print("{}: {} triangles, {} frames of {}\n", place.string(), avatar.body.faceCount,
                   keys, motion->name);
    else
        fmt::print("{}: {} triangles\n", place.string(), avatar.body.faceCount);
    if (isPage && !options.common.json)
        fmt::print("open {} in a browser; README.txt beside it says how it goes into other pages\n",
                   (place / "page.html").string());
}

namespace {

// By VRM's own words, with those that allow least where nothing is said.
void declarePermissions(CommandFlags& flags, ExportOptions& o) {
    flags->add_option("--author", o.author, "Of a .vrm: whose avatar it is");
    flags->add_option("--licence", o.licence,
                      "Of a .vrm: address of a licence, beside VRM's own with the answers below");
    VrmPermissions& may = o.permissions;
    flags->add_option("--avatar-permission", may.wearer, "Of a .vrm: who may wear it")
        ->capture_default_str()
        ->check(showsChoices({"onlyAuthor", "onlySeparatelyLicensedPerson", "everyone"}));
    flags->add_option("--commercial-usage", may.commercial, "Of a .vrm: who may earn by it")
        ->capture_default_str()
        ->check(showsChoices({"personalNonProfit", "personalProfit", "corporation"}));
    flags->add_option("--modification", may.modification, "Of a .vrm: whether it may be changed")
        ->capture_default_str()
        ->check(
            showsChoices({"prohibited", "allowModification", "allowModificationRedistribution"}));
    flags->add_option("--credit-notation", may.credit, "Of a .vrm: whether to name the author")
        ->capture_default_str()
        ->check(showsChoices({"required", "unnecessary"}));
    flags
        ->add_option("--allow", o.allowed,
                     "Of a .vrm: what else the person who is shown consents to, separated by "
                     "commas: violence, sexual, politics, hate, redistribution")
        ->delimiter(',');
}

void takeAllowed(ExportOptions& options) {
    VrmPermissions& may = options.permissions;
    const std::pair<const char*, bool*> questions[] = {{"violence", &may.violence},
                                                       {"sexual", &may.sexual},
                                                       {"politics", &may.politics},
                                                       {"hate", &may.hate},
                                                       {"redistribution", &may.redistribution}};
    for (const std::string& word : options.allowed) {
        const auto* found =
            std::ranges::find(questions, word, [](const auto& q) { return q.first; });
        if (found == std::end(questions))
            throwInput(
                "--allow: expected violence, sexual, politics, hate or redistribution, found "
                "\"{}\"",
                printable(word));
        *found->second = true;
    }
}

void declareFlags(CommandFlags& flags, ExportOptions& o) {
    flags.precision();
    flags.path("AVATAR", o.avatar, "Avatar's folder")->required();
    flags.path(
        "--out", o.out,
        "FILE.glb, .vrm (VRM 1.0), .usda (with FILE.png beside it) or .obj (with FILE.mtl and "
        "FILE.png); or the motion alone: .bvh, .npz (AMASS's) or .json");
    flags.path("--web", o.web,
               "In the place of --out: a folder that shows the avatar in browsers, page.html by a "
               "double click, the rest from any web server; with play, orbit and joints");
    flags.path(
        "--networks", o.networks,
        "In the place of --out: a folder with the avatar's networks as ONNX and safetensors");
    flags.paths("--motion", o.motions,
                "A capture, a poses.npz, BVH, FBX, glTF, USD, JSON, AMASS or an estimator's poses, "
                "which becomes "
                "an animation; of .glb and --web several times");
    flags.frames(o.frames, "Frames of the motion");
    flags.retarget(o.retarget);
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
                    "Of .glb, .vrm and --web: a morph target for each shape coefficient, and those "
                    "that curl and close each hand");
    flags
        ->add_option("--material", o.material,
                     "Of .glb, .vrm, .usda and --web: unlit, seen as the texture is whatever "
                     "lights there are, or lit by those of the scene")
        ->capture_default_str()
        ->check(showsChoices({"unlit", "lit"}));
    declarePermissions(flags, o);
}

void checkName(ExportOptions& options) {
    std::vector<const char*> given;
    if (!options.out.empty()) given.push_back("--out");
    if (!options.web.empty()) given.push_back("--web");
    if (!options.networks.empty()) given.push_back("--networks");
    if (given.size() != 1)
        throwInput(
            "--out: expected one of --out FILE, --web FOLDER and --networks FOLDER, found {}",
            given.empty() ? "none" : fmt::format("{}", fmt::join(given, " and ")));
    takeAllowed(options);
    if (!options.networks.empty()) {
        const std::pair<const char*, bool> others[] = {
            {"--motion", !options.motions.empty()},
            {"--frames", !options.frames.empty()},
            {"--shapes", options.shapes},
            {"--material lit", options.material == "lit"},
            {"--allow", !options.allowed.empty()},
            {"--author", !options.author.empty()},
            {"--licence", !options.licence.empty()},
            {"--avatar-permission", options.permissions.wearer != VrmPermissions{}.wearer},
            {"--commercial-usage", options.permissions.commercial != VrmPermissions{}.commercial},
            {"--modification", options.permissions.modification != VrmPermissions{}.modification},
            {"--credit-notation", options.permissions.credit != VrmPermissions{}.credit}};
        for (const auto& [flag, isGiven] : others)
            if (isGiven) throwInput("{}: expected --out or --web, found --networks", flag);
        return;
    }
    if (!options.web.empty()) {
        if (!options.author.empty() || !options.licence.empty())
            throwInput("{}: expected a .vrm, found --web",
                       options.author.empty() ? "--licence" : "--author");
    } else if (!isExportName(options.out))
        throwInput(
            "--out: expected a name that ends in .glb, .vrm, .usda, .obj, .bvh, .npz or .json, "
            "found \"{}\"",
            options.out.string());
    if (isMotionFile(options.out) && options.motions.empty())
        throwInput("--motion: expected one for {}, which is a motion's file, found none",
                   options.out.string());
    if (!options.retarget.contacts.empty() && options.motions.size() != 1)
        throwInput("--contacts: expected one --motion, whose contacts they are, found {}",
                   options.motions.size());
    jointNamesByWord(options.names, "--names");
}

const Command<ExportOptions> kExport{{
    .name = "export",
    .place = 80,
    .summary =
        "Write the avatar for other programs, as glTF, VRM, USD, OBJ, for browsers; or a motion "
        "on its bones; or its networks",
    .description =
        "Writes a skinned mesh with 24 joints and one texture for all views, and a motion as an\n"
        "animation: glTF (.glb), VRM 1.0 (.vrm), USD (.usda), pages for browsers (--web); or one\n"
        "pose as OBJ. A motion alone, on the avatar's skeleton, goes to BVH, AMASS's npz or JSON; "
        "the\n"
        "networks alone to ONNX and safetensors (--networks).",
    .example = "doppel export avatar --out avatar.glb --motion capture",
    .flags = declareFlags,
    .check = checkName,
    .run = runExport,
}};

}  // namespace

}  // namespace doppel
