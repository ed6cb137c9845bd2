// One subcommand of `doppel`. The source file that does its work also declares its flags, and
// thereby adds it; there is no other list of commands:
//
//     struct FitOptions {
//         CommonOptions common;
//         std::filesystem::path capture, out;
//         Preset preset;
//     };
//
//     const Command<FitOptions> kFit{{
//         .name = "fit",
//         .place = 30,
//         .summary = "Refine shape, poses and positions until the body fills the masks",
//         .example = "doppel fit capture --out fitted",
//         .flags =
//             [](CommandFlags& flags, FitOptions& o) {
//                 flags.path("CAPTURE", o.capture, "Capture to read")->required();
//                 flags.path("--out", o.out, "Capture to write")->required();
//                 flags.preset("small");
//             },
//         .run = runFit,
//     }};
//
// Results go to stdout (as one JSON object with common.json), progress to stderr; failures are
// thrown. Options that others fill in, tests among them, stand in a header beside the source file.
#pragma once

#include <CLI/CLI.hpp>
#include <any>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "engine/device.h"
#include "trainer/avatar/preset.h"
#include "trainer/commands/common_options.h"
#include "trainer/eval/measures.h"
#include "trainer/motion/retarget/retarget.h"

namespace doppel {

// What a command line comes to.
struct ParsedCommand {
    std::string name;
    CommonOptions common;
    std::any options;  // the command's own
    std::function<void()> run;
};

// The flags of a command while they are declared: CLI11's by ->, and those that several share.
class CommandFlags {
public:
    CommandFlags(CLI::App& app, CommonOptions& common, std::string& preset,
                 std::vector<std::string>& set)
        : app_(app), common_(common), preset_(preset), set_(set) {}
    CLI::App* operator->() const { return &app_; }

    // A file or folder; an empty text is refused.
    CLI::Option* path(const std::string& name, std::filesystem::path& path,
                      const std::string& help);
    // As many as the flag is given.
    CLI::Option* paths(const std::string& name, std::vector<std::filesystem::path>& paths,
                       const std::string& help);
    // --precision, of commands that run networks. Comes first.
    void precision();
    // --preset and --set: fill in the options' member `preset`.
    void preset(const char* fallback);
    void body(std::string& body);
    // --prior: who tells what frames do not show (trainer/stages/prior/people.h).
    void prior(std::vector<std::string>& from);
    // what: "Frames to fit".
    void frames(std::string& frames, const char* what);
    void texture(std::string& texture);  // a word of textureKind()
    void scene(std::string& scene);
    // --retarget, --contacts, --reach: of a motion for a body.
    void retarget(RetargetSettings& settings);
    void measures(MeasureOptions& measures);
    void memory(uint64_t& bytes);

private:
    CLI::App& app_;
    CommonOptions& common_;
    std::string& preset_;
    std::vector<std::string>& set_;
};

// A command without its options' type.
struct CommandEntry {
    // Makes the options of one command line, from what was common and, where the command declares
    // one, the preset. To be called while the flags' App is alive.
    using Finish = std::function<ParsedCommand(const CommonOptions& common, const Preset* preset)>;

    std::string name, summary, description, example;
    int place = 0;
    std::function<Finish(CommandFlags&)> declare;

    static const std::vector<CommandEntry>& all();  // as help lists them
    static void add(CommandEntry entry);
};

template <typename Options>
class Command {
public:
    struct Declaration {
        const char* name;
        int place;                     // in the list that help shows: ascending
        const char* summary;           // a line in that list
        const char* description = "";  // in the command's own help; empty: the summary
        const char* example;
        void (*flags)(CommandFlags& flags, Options& options) = nullptr;
        // What flags cannot say one by one: throws InputErrors that name them; may be null.
        void (*check)(Options& options) = nullptr;
        void (*run)(const Options& options);
    };

    explicit Command(const Declaration& d) {
        CommandEntry::add({d.name, d.summary, d.description, d.example, d.place,
                           [d](CommandFlags& flags) -> CommandEntry::Finish {
                               auto options = std::make_shared<Options>();
                               if (d.flags) d.flags(flags, *options);
                               return
                                   [d, options](const CommonOptions& common, const Preset* preset) {
                                       options->common = common;
                                       if constexpr (requires { options->preset; })
                                           options->preset = *preset;
                                       if (d.check) d.check(*options);
                                       return ParsedCommand{d.name, common, *options,
                                                            [d, options] { d.run(*options); }};
                                   };
                           }});
    }
};

// The result of a command with --json. Texts that are not UTF-8, such as names of files, are
// written with U+FFFD in place of what is not.
void printJson(const nlohmann::ordered_json& json);

}  // namespace doppel
