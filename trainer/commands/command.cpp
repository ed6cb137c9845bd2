#include "trainer/commands/command.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "trainer/commands/manual/choices.h"

namespace doppel {

namespace {

std::string notEmpty(const std::string& text) {
    return text.empty() ? "expected a path, found an empty text" : "";
}

}  // namespace

CLI::Option* CommandFlags::path(const std::string& name, std::filesystem::path& path,
                                const std::string& help) {
    return app_.add_option(name, path, help)->type_name("PATH")->check(notEmpty);
}

CLI::Option* CommandFlags::paths(const std::string& name, std::vector<std::filesystem::path>& paths,
                                 const std::string& help) {
    return app_.add_option(name, paths, help)
        ->type_name("PATH")
        ->allow_extra_args(false)
        ->check(notEmpty);
}

void CommandFlags::precision() {
    app_.add_option("--precision", common_.precision,
                    "Of the networks' products: fp32; mixed: inputs in half, sums in single "
                    "precision, on matrix units where the device has them (`doppel devices`)")
        ->capture_default_str()
        ->check(CLI::IsMember({"fp32", "mixed"}))
        ->group("Common");
}

void CommandFlags::preset(const char* fallback) {
    preset_ = fallback;
    app_.add_option("--preset", preset_, "Sizes, steps and rates")
        ->capture_default_str()
        ->check(showsChoices(presetNames()));
    app_.add_option("--set", set_,
                    "One number of the preset, as NAME=VALUE (mesh.batch=8); may be repeated; "
                    "--help-presets lists them")
        ->type_name("NAME=VALUE")
        ->take_all()
        ->allow_extra_args(false);
    app_.add_flag_callback(
        "--help-presets",
        [] {
            std::string text = presetHelp();
            text.pop_back();  // the line's end, which comes with it
            throw CLI::CallForVersion(text, 0);
        },
        "Print every number of the presets, its range and what it means, and exit");
}

void CommandFlags::body(std::string& body) {
    body = "default";
    app_.add_option("--body", body,
                    "Body model: default, default-full, or SMPL's own .npz or .pkl file")
        ->capture_default_str()
        ->type_name("NAME|FILE");
}

void CommandFlags::prior(std::vector<std::string>& from) {
    app_.add_option("--prior", from,
                    "Who tells what the frames do not show: \"cast\" (fifty synthetic people; "
                    "cast-7-19 leaves out members 7 and 19 of 0 to 49), avatars, folders of "
                    "avatars, with commas; or \"none\". Without it the cast, of four frames or "
                    "fewer")
        ->delimiter(',')
        ->allow_extra_args(false)  // the next word is another's
        ->type_name("WHO");
}

void CommandFlags::frames(std::string& frames, const char* what) {
    app_.add_option("--frames", frames,
                    fmt::format("{}: a:b is from a up to but not b, a:b:step, lists with commas; "
                                "negative numbers count from the end",
                                what));
}

void CommandFlags::retarget(RetargetSettings& settings) {
    app_.add_option_function<std::string>(
            "--retarget", [&settings](const std::string& word) { settings.on = word == "on"; },
            "Fit the motion to the avatar where its body differs from the one that moved: root "
            "scaled by the legs, feet kept on the ground, limbs out of the body; frames that the "
            "avatar was learnt from take the poses that training found; off: as it is")
        ->default_str("on")
        ->check(CLI::IsMember({"on", "off"}));
    path("--contacts", settings.contacts,
         "When heels and toes stand on the ground, .json or .npz (docs/formats.md); without: found "
         "in the motion");
    app_.add_option("--reach", settings.reach,
                    "Hands go where the source's rotations take them, and touch what they touched "
                    "(each other, the hips); or to the source's points in space: as high above the "
                    "ground, as far from the root")
        ->capture_default_str()
        ->check(CLI::IsMember({"proportion", "space"}));
}

void CommandFlags::texture(std::string& texture) {
    app_.add_option("--texture", texture,
                    "coarse, refined (for each view), baked (one for all views), or best: refined "
                    "where the avatar has it")
        ->capture_default_str()
        ->check(showsChoices({"coarse", "refined", "baked", "best"}));
}

void CommandFlags::scene(std::string& scene) {
    app_.add_option("--scene", scene,
                    "frame: the frame's own pixels away from the mask, the median over time on it; "
                    "median: that everywhere; or a picture of the empty scene")
        ->capture_default_str()
        ->type_name("NAME|FILE");
}

void CommandFlags::measures(MeasureOptions& measures) {
    app_.add_option("--lpips", measures.lpips,
                    "Weights for LPIPS, .safetensors or .pth: torchvision's network and LPIPS "
                    "0.1's heads, in two files or one")
        ->delimiter(',')
        ->type_name("FILE[,FILE]");
    app_.add_option("--lpips-net", measures.lpipsNet, "Their network: alex, vgg or squeeze")
        ->capture_default_str()
        ->check(showsChoices({"alex", "vgg", "squeeze"}));
    app_.add_option("--fvd", measures.fvd,
                    "Weights of Inception-3D (RGB, Kinetics) for FVD, .safetensors or .pt")
        ->type_name("FILE");
}

void CommandFlags::memory(uint64_t& bytes) {
    app_.add_option("--memory", bytes,
                    "Device memory to use at most (6GB, 512MB); default: what the device has")
        ->transform(CLI::AsSizeValue(false))
        ->transform([](const std::string& text) {  // comes before the other one
            if (text.empty() || text[0] < '0' || text[0] > '9')
                throw CLI::ValidationError(
                    fmt::format("expected a number of bytes, as 6GB or 512MB, found \"{}\"", text));
            return text;
        })
        ->check([](const std::string& text) {
            return std::string(text == "0" ? "expected more than 0 bytes" : "");
        });
}

namespace {

std::vector<CommandEntry>& commands() {
    static std::vector<CommandEntry> all;
    return all;
}

}  // namespace

const std::vector<CommandEntry>& CommandEntry::all() { return commands(); }

void CommandEntry::add(CommandEntry entry) {
    const auto at =
        std::upper_bound(commands().begin(), commands().end(), entry.place,
                         [](int place, const CommandEntry& other) { return place < other.place; });
    commands().insert(at, std::move(entry));
}

void printJson(const nlohmann::ordered_json& json) {
    using Json = nlohmann::ordered_json;
    std::cout << json.dump(2, ' ', false, Json::error_handler_t::replace) << "\n";
}

}  // namespace doppel
