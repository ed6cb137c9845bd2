// `doppel mix`.
#include "trainer/avatar/mix/mix.h"

#include <fmt/format.h>

#include <array>
#include <list>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/rendering.h"
#include "trainer/commands/command.h"
#include "trainer/data/output_folder.h"

namespace doppel {

namespace {

struct MixOptions {
    CommonOptions common;
    std::filesystem::path base, head, hair, top, bottom, shoes, hands, shape, out;
};

// What an avatar is given by others.
struct Part {
    const char *name, *flag, *text;
    std::filesystem::path MixOptions::*folder;
    const Avatar* MixParts::*giver;
};
constexpr std::array<Part, 7> kParts = {{
    {"head", "--head", "Whose face, ears and neck, and whose skin's colour; with the hair",
     &MixOptions::head, &MixParts::head},
    {"hair", "--hair", "Whose hair", &MixOptions::hair, &MixParts::hair},
    {"top", "--top", "Whose shirt, blouse or jacket", &MixOptions::top, &MixParts::top},
    {"bottom", "--bottom", "Whose trousers or skirt", &MixOptions::bottom, &MixParts::bottom},
    {"shoes", "--shoes", "Whose shoes", &MixOptions::shoes, &MixParts::shoes},
    {"hands", "--hands", "Whose hands", &MixOptions::hands, &MixParts::hands},
    {"shape", "--shape", "Whose body under the clothes", &MixOptions::shape, &MixParts::shape},
}};

void runMix(const MixOptions& options) {
    std::vector<std::filesystem::path> inputs{options.base};
    for (const Part& part : kParts) inputs.push_back(options.*part.folder);
    requireApart(options.out, inputs);
    if (std::filesystem::exists(options.out / "avatar.toml") &&
        !readAvatar(options.out).provenance.contains("mixed"))
        throwInput(
            "{}: expected a new folder or that of an earlier mix, found an avatar that was "
            "trained; name another folder",
            options.out.string());
    OutputFolder folder(options.out, kAvatarKind);

    // A list, so that avatars keep their places.
    std::list<std::pair<std::filesystem::path, Avatar>> avatars;
    auto avatarIn = [&](const std::filesystem::path& path) {
        for (const auto& [known, avatar] : avatars)
            if (known == path) return &avatar;
        avatars.emplace_back(path, readAvatar(path));
        requireTexture(avatars.back().second, TextureKind::Best, path);
        return &std::as_const(avatars.back().second);
    };
    MixParts parts;
    parts.base = avatarIn(options.base);
    for (const Part& part : kParts)
        if (!(options.*part.folder).empty()) parts.*part.giver = avatarIn(options.*part.folder);

    Mix mix = mixAvatars(parts);
    mix.avatar.provenance["mixed"] = options.base.string();
    mix.avatar.provenance["command"] = options.common.commandLine;
    for (const Part& part : kParts)
        if (!(options.*part.folder).empty())
            mix.avatar.provenance[part.name] = (options.*part.folder).string();
    writeAvatar(folder.folder(), mix.avatar);
    Device device(options.common.deviceOptions());
    writePreview(device, mix.avatar, folder.folder() / "preview.png");
    folder.commit();

    if (!mix.capsWorn)
        fmt::print(
            stderr,
            "{}: hair and loose cloth that hang free are left out: the texture has no room\n",
            options.out.string());
    // mix.given has the base first, and the parts' order but for the shape, which covers nothing.
    if (options.common.json) {
        nlohmann::ordered_json json{{"out", options.out.string()}};
        nlohmann::ordered_json& given = json["given"];
        given["base"] = mix.given[0];
        for (size_t i = 0; i + 1 < kParts.size(); ++i)
            if (!(options.*kParts[i].folder).empty()) given[kParts[i].name] = mix.given[i + 1];
        json["unseen"] = mix.unseen;
        printJson(json);
        return;
    }
    fmt::print("{}: {:.0f} % of {}", options.out.string(), 100 * mix.given[0],
               options.base.string());
    for (size_t i = 0; i + 1 < kParts.size(); ++i)
        if (!(options.*kParts[i].folder).empty())
            fmt::print(", {} ({:.0f} %) of {}", kParts[i].name, 100 * mix.given[i + 1],
                       (options.*kParts[i].folder).string());
    if (!options.shape.empty()) fmt::print(", shape of {}", options.shape.string());
    fmt::print("\n");
    if (mix.unseen > 0)
        fmt::print("{:.1f} % is covered in all of them and takes after what is around\n",
                   100 * mix.unseen);
}

void declareFlags(CommandFlags& flags, MixOptions& o) {
    flags.path("AVATAR", o.base, "Avatar's folder, who has what no flag says")->required();
    for (const Part& part : kParts) flags.path(part.flag, o.*part.folder, part.text);
    flags.path("--out", o.out, "Avatar's folder to write")->required();
}

const Command<MixOptions> kMix{{
    .name = "mix",
    .place = 45,
    .summary = "Dress an avatar with the clothes, hair or head of others",
    .description =
        "Makes one avatar of several: who wears what is told by colours and places on the body\n"
        "(skin, hair, top, bottom, shoes). Skin takes the colour of the head's. The result has "
        "one\n"
        "texture for all views and no networks; the avatars must have been trained with the same\n"
        "--body.",
    .example = "doppel mix avatar --top other/avatar --hair other/avatar --out mixed",
    .flags = declareFlags,
    .check =
        [](MixOptions& o) {
            for (const Part& part : kParts)
                if (!(o.*part.folder).empty()) return;
            throwInput(
                "mix: expected who gives something: --head, --hair, --top, --bottom, "
                "--shoes, --hands or --shape, found none");
        },
    .run = runMix,
}};

}  // namespace

}  // namespace doppel
