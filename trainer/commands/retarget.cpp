// `doppel retarget`.
#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "trainer/avatar/rendering.h"
#include "trainer/commands/command.h"
#include "trainer/commands/render.h"
#include "trainer/data/capture_notes.h"
#include "trainer/data/output_folder.h"
#include "trainer/motion/upright.h"

namespace doppel {

namespace {

struct RetargetCommandOptions {
    CommonOptions common;
    std::filesystem::path motion, avatar, out;
    RetargetSettings settings;
};

struct Figure {
    const char *name, *text;
    double RetargetFigures::*value;
};
constexpr std::array<Figure, 9> kFigures = {{
    {"slide_mm_per_frame", "feet slide in contact, mm a frame", &RetargetFigures::slide},
    {"contact_height_mm", "feet off the ground in contact, mm", &RetargetFigures::height},
    {"sunk_mm", "soles below the ground, mm", &RetargetFigures::sunk},
    {"deepest_mm", "soles below the ground at most, mm", &RetargetFigures::deepest},
    {"overlap_mm", "limbs in the body, mm more than the source's", &RetargetFigures::overlap},
    {"touch_mm", "hands off what they should touch, mm", &RetargetFigures::touch},
    {"wrong_contacts_percent", "frames with wrong contacts of feet, %",
     &RetargetFigures::wrongContacts},
    {"acceleration", "acceleration of joints, m/s\u00b2", &RetargetFigures::acceleration},
    {"sharpest", "largest acceleration of a joint, m/s\u00b2", &RetargetFigures::sharpest},
}};

void runRetarget(const RetargetCommandOptions& options) {
    std::vector<std::filesystem::path> inputs = originsOf(options.motion);
    inputs.insert(inputs.end(), {options.avatar, options.settings.contacts});
    requireApart(options.out, inputs);
    const Avatar avatar = readAvatar(options.avatar);
    Motion motion = readMotion(options.motion);
    if (const std::string taken = takenAs(motion); !taken.empty())
        fmt::print(stderr, "{}: {}\n", options.motion.string(), taken);
    const Retargeted result =
        performed(avatar, options.avatar, std::move(motion), options.settings);
    Npz arrays = posesArrays(result.motion.theta, result.motion.trans, avatar.betas);
    arrays.set("fps", Array::scalarF64(result.motion.fps));
    if (!result.contacts.empty()) addContacts(arrays, result.contacts);
    writeNpz(options.out, arrays, true);
    if (options.common.json) {
        nlohmann::ordered_json json{{"out", options.out.string()},
                                    {"frames", result.motion.size()},
                                    {"changed", result.changed},
                                    {"training_poses", result.found}};
        if (result.changed) json.update(retargetJson(result));
        printJson(json);
        return;
    }
    fmt::print("{}: {} frames; {}\n", options.out.string(), result.motion.size(),
               !result.summary.empty() ? result.summary
               : options.settings.on
                   ? "it is of the avatar's own body or frames, and stays as it is"
                   : "it stays as it is");
    if (!result.changed) return;
    fmt::print("{:<46}{:>10}{:>10}{:>12}\n", "", "source", "as it is", "retargeted");
    for (const Figure& figure : kFigures)
        fmt::print("{:<46}{:>10.2f}{:>10.2f}{:>12.2f}\n", figure.text,
                   (*result.source).*figure.value, (*result.before).*figure.value,
                   (*result.after).*figure.value);
}

void declareFlags(CommandFlags& flags, RetargetCommandOptions& o) {
    flags
        .path("MOTION", o.motion,
              "A capture, a poses.npz, BVH, FBX, glTF, USD, JSON, AMASS or an estimator's poses "
              "(docs/formats.md)")
        ->required();
    flags.path("--avatar", o.avatar, "Avatar's folder, who is to move")->required();
    flags.path("--out", o.out, "FILE.npz: poses of the avatar's body, and contacts")->required();
    flags.retarget(o.settings);
}

const Command<RetargetCommandOptions> kRetarget{{
    .name = "retarget",
    .place = 55,
    .summary = "Fit a motion to an avatar's body, and say how well its feet stand",
    .description = "Writes the motion as render, export and view play it: the root scaled by the "
                   "ratio of the\n"
                   "legs, feet kept where they stand on the ground, limbs out of the body. Prints "
                   "how far feet\n"
                   "slide, float and sink, and limbs go into the body, before and after.",
    .example = "doppel retarget dance.bvh --avatar avatar --out dance.npz",
    .flags = declareFlags,
    .check =
        [](RetargetCommandOptions& o) {
            if (endingOf(o.out) != ".npz")
                throwInput("--out: expected a name that ends in .npz, found \"{}\"",
                           o.out.string());
        },
    .run = runRetarget,
}};

}  // namespace

nlohmann::ordered_json retargetJson(const Retargeted& retargeted) {
    nlohmann::ordered_json json{{"root_scale", retargeted.rootScale},
                                {"contacts", retargeted.stays}};
    const auto add = [&](const char* name, const std::optional<RetargetFigures>& figures) {
        if (!figures) return;
        for (const Figure& figure : kFigures) json[name][figure.name] = (*figures).*figure.value;
    };
    add("source", retargeted.source);
    add("before", retargeted.before);
    add("after", retargeted.after);
    return json;
}

}  // namespace doppel
