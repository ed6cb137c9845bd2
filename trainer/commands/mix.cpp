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
    std::filesystem::path base, out;
    std::array<std::filesystem::path, kMixParts.size()> givers;  // of the parts; empty: the base
};

void runMix(const MixOptions& options) {
    std::vector<std::filesystem::path> inputs{options.base};
    inputs.insert(inputs.end(), options.givers.begin(), options.givers.end());
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
    for (size_t p = 0; p < kMixParts.size(); ++p)
        if (!options.givers[p].empty()) parts.*kMixParts[p].giver = avatarIn(options.givers[p]);

    Mix mix = mixAvatars(parts);
    mix.avatar.provenance["mixed"] = options.base.string();
    mix.avatar.provenance["command"] = options.common.commandLine;
    for (size_t p = 0; p < kMixParts.size(); ++p)
        if (!options.givers[p].empty())
            mix.avatar.provenance[kMixParts[p].name] = options.givers[p].string();
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
        for (size_t i = 0; i + 1 < kMixParts.size(); ++i)
            if (!options.givers[i].empty()) given[kMixParts[i].name] = mix.given[i + 1];
        json["unseen"] = mix.unseen;
        printJson(json);
        return;
    }
    fmt::print("{}: {:.0f} % of {}", options.out.string(), 100 * mix.given[0],
               options.base.string());
    for (size_t i = 0; i + 1 < kMixParts.size(); ++i)
        if (!options.givers[i].empty())
            fmt::print(", {} ({:.0f} %) of {}", kMixParts[i].name, 100 * mix.given[i + 1],
                       options.givers[i].string());
    if (!options.givers.back().empty()) fmt::print(", shape of {}", options.givers.back().string());
    fmt::print("\n");
    if (mix.unseen > 0)
        fmt::print("{:.1f} % is covered in all of them and takes after what is around\n",
                   100 * mix.unseen);
}

void declareFlags(CommandFlags& flags, MixOptions& o) {
    flags.path("AVATAR", o.base, "Avatar's folder, who has what no flag says")->required();
    for (size_t p = 0; p < kMixParts.size(); ++p)
        flags.path(std::string("--") + kMixParts[p].name, o.givers[p], kMixParts[p].text);
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
            for (const std::filesystem::path& giver : o.givers)
                if (!giver.empty()) return;
            throwInput(
                "mix: expected who gives something: --head, --hair, --top, --bottom, "
                "--shoes, --hands or --shape, found none");
        },
    .run = runMix,
}};

}  // namespace

}  // namespace doppel
