#include "trainer/commands/cli.h"

#include <fmt/ranges.h>

#include <toml++/toml.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <sstream>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/data/progress.h"
#include "trainer/data/version.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// A command in one command line: the values of the flags that all have, and its own.
struct Subcommand {
    CommonOptions common;
    fs::path config;
    std::string preset;
    std::vector<std::string> set;
    CommandEntry::Finish finish;

    Subcommand(CLI::App& app, const CommandEntry& entry) {
        CLI::App& command = *app.add_subcommand(entry.name, entry.summary);
        if (!entry.description.empty()) command.description(entry.description);
        command.footer("Example:\n  " + entry.example);
        command.get_formatter()->column_width(32);
        command
            .add_option("--device", common.device,
                        "Vulkan device: part of its name or its number in `doppel devices`; auto, "
                        "or nothing: the best one")
            ->transform([](const std::string& name) { return name == "auto" ? "" : name; })
            ->group("Common");
        command.add_option("--seed", common.seed, "Same seed, same device: same result")
            ->capture_default_str()
            ->check(CLI::NonNegativeNumber)
            ->group("Common");
        command.add_flag("--json", common.json, "Print the result as one JSON object")
            ->group("Common");
        CommandFlags flags(command, common, preset, set);
        flags.path("--config", config, "TOML file with options as keys; flags win over it")
            ->group("Common");
        finish = entry.declare(flags);
    }
};

// The list of commands has a line of each; what there is to say of it stands in its own help.
class Overview : public CLI::Formatter {
public:
    std::string make_subcommand(const CLI::App* command) const override {
        std::ostringstream line;
        for (const CommandEntry& entry : CommandEntry::all())
            if (entry.name == command->get_name())
                CLI::detail::format_help(line, entry.name, entry.summary, column_width_);
        return line.str();
    }
};

// A TOML value as the words that a flag would be given.
std::vector<std::string> wordsOf(const toml::node& node, const std::string& where) {
    if (const auto* list = node.as_array()) {
        std::vector<std::string> words;
        for (const toml::node& element : *list) {
            for (std::string& word : wordsOf(element, where)) words.push_back(std::move(word));
        }
        return words;
    }
    if (const auto* text = node.as_string()) return {text->get()};
    if (const auto* whole = node.as_integer()) return {fmt::format("{}", whole->get())};
    if (const auto* number = node.as_floating_point()) return {fmt::format("{}", number->get())};
    if (const auto* flag = node.as_boolean()) return {flag->get() ? "true" : "false"};
    throwInput("{}: expected a text, a number, true or false, or a list of these", where);
}

toml::table readConfig(const fs::path& path) {
    const std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{1} << 20);
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    try {
        return toml::parse(text, path.string());
    } catch (const toml::parse_error& error) {
        throwInput("{}: line {}: not TOML: {}", path.string(), error.source().begin.line,
                   error.description());
    }
}

// Gives the command's options that were not typed their values from the file. Positional arguments
// are typed always.
void applyConfig(const toml::table& config, const fs::path& path, CLI::App& command,
                 CLI::App& app) {
    const auto optionOf = [](CLI::App& of, const std::string& key) -> CLI::Option* {
        CLI::Option* option = of.get_option_no_throw("--" + key);
        return option && !key.starts_with("help") && key != "config" ? option : nullptr;
    };
    for (const auto& [tomlKey, node] : config) {
        const std::string key(tomlKey.str());
        const std::string where = fmt::format("{}: {}", path.string(), key);
        if (node.is_table()) {
            if (std::ranges::count(presetSections(), key) > 0) continue;
            throwInput("{}: expected one of the tables {}, found another", where,
                       fmt::join(presetSections(), ", "));
        }
        const auto subcommands = app.get_subcommands([](CLI::App*) { return true; });
        if (std::none_of(subcommands.begin(), subcommands.end(),
                         [&](CLI::App* c) { return optionOf(*c, key); })) {
            throwInput("{}: expected the name of an option, found one that no command has", where);
        }
        CLI::Option* option = optionOf(command, key);
        if (option == nullptr || option->count() > 0) continue;
        const std::vector<std::string> words = wordsOf(node, where);
        if (words.empty()) continue;
        try {
            option->add_result(words);
            option->run_callback();
        } catch (const CLI::Error& error) {
            throwInput("{}: {}", where, error.what());
        }
    }
}

Preset presetOf(const Subcommand& shared, const toml::table& config) {
    Preset preset = presetByName(shared.preset);
    for (const std::string& section : presetSections()) {
        const toml::table* table = config[section].as_table();
        if (table == nullptr) continue;
        for (const auto& [key, node] : *table) {
            const std::string name = fmt::format("{}.{}", section, key.str());
            const auto words = wordsOf(node, fmt::format("{}: {}", shared.config.string(), name));
            if (words.size() != 1) {
                throwInput("{}: {}: expected one value, found {}", shared.config.string(), name,
                           words.size());
            }
            setPresetValue(preset, name, words[0], shared.config.string());
        }
    }
    for (const std::string& text : shared.set) {
        const size_t equals = text.find('=');
        if (equals == std::string::npos) {
            throwInput("--set: expected NAME=VALUE (mesh.batch=8), found \"{}\"", text);
        }
        setPresetValue(preset, text.substr(0, equals), text.substr(equals + 1), "--set");
    }
    checkPreset(preset, shared.preset);
    return preset;
}

// What CLI11 found wrong, as our one line.
std::string parseSentence(const CLI::App& app, const CLI::ParseError& error) {
    const auto chosen = app.get_subcommands();
    const std::string name = chosen.empty() ? "doppel" : "doppel " + chosen[0]->get_name();
    std::string sentence = error.what();
    std::replace(sentence.begin(), sentence.end(), '\n', ' ');
    while (!sentence.empty() && (sentence.back() == ' ' || sentence.back() == '.')) {
        sentence.pop_back();
    }
    if (dynamic_cast<const CLI::RequiredError*>(&error) && chosen.empty()) {
        sentence = "a command is missing";
    }
    return fmt::format("{}: {}; `{} --help` tells more", name, sentence, name);
}

struct CommandLine {
    CLI::App app{"Doppel makes a controllable avatar of a recorded person.", "doppel"};
    std::map<std::string, Subcommand> commands;

    CommandLine() {
        app.formatter(std::make_shared<Overview>());
        app.require_subcommand(1);
        app.set_version_flag("--version", std::string("doppel ") + kVersion);
        std::string footer;
        for (const auto& [what, lines] : exampleTexts()) {
            footer += fmt::format("{}\n  ", what);
            for (const char* c = lines; *c; ++c) footer += *c == '\n' ? "\n  " : std::string(1, *c);
            footer += "\n";
        }
        app.footer(fmt::format("{}\n`doppel COMMAND --help` tells more. Exit status: {}", footer,
                               exitStatusText()));
        // Options are bound to where they are: in a map's nodes, which stay.
        for (const CommandEntry& entry : CommandEntry::all())
            commands.try_emplace(entry.name, app, entry);
    }
};

int statusOf(const std::function<void()>& run, std::ostream& err) {
    try {
        run();
        return 0;
    } catch (const Interrupted& stop) {
        err << "doppel: interrupted" << (stop.kept.empty() ? "" : "; kept: ") << stop.kept << "\n";
        return interruptStatus();
    } catch (const InputError& error) {
        err << "doppel: " << error.what() << "\n";
        return 2;
    } catch (const std::bad_alloc&) {
        err << "doppel: the machine's memory is used up\n";
    } catch (const std::exception& error) {  // MachineError among them
        err << "doppel: " << error.what() << "\n";
    }
    return 1;
}

}  // namespace

void withCommandLine(const std::function<void(const CLI::App&)>& use) { use(CommandLine().app); }

std::vector<ExampleText> exampleTexts() {
    return {{"From a clip to an avatar that dances somebody else's motion:",
             "doppel avatar clip.mp4 --out me\n"
             "doppel render me/avatar --motion other-capture --out dance.mp4"},
            {"The first of them step by step (train fits the body to the masks first):",
             "doppel import SRC --out capture\n"
             "doppel train capture --out avatar --preset small"}};
}

const char* exitStatusText() {
    return "0 done, 1 it failed, 2 the input or\n"
           "the flags are wrong, 130, 143 or 129 stopped by Ctrl-C, SIGTERM or SIGHUP.";
}

int runCommandLine(const std::vector<std::string>& arguments, std::ostream& out, std::ostream& err,
                   const std::function<void(const ParsedCommand&)>& run) {
    CommandLine line;
    if (!arguments.empty() && !arguments[0].starts_with('-') &&
        !line.commands.contains(arguments[0])) {
        std::vector<std::string> names;
        for (const CommandEntry& entry : CommandEntry::all()) names.push_back(entry.name);
        err << fmt::format("doppel: there is no command \"{}\"; there are {}\n", arguments[0],
                           fmt::join(names, ", "));
        return 2;
    }
    try {
        // CLI11 takes them from the back.
        line.app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
    } catch (const CLI::Success& success) {  // --help, --version
        return line.app.exit(success, out, err);
    } catch (const CLI::ParseError& error) {
        err << parseSentence(line.app, error) << "\n";
        return 2;
    }
    CLI::App& command = *line.app.get_subcommands().front();
    Subcommand& given = line.commands.at(command.get_name());
    given.common.commandLine = fmt::format("doppel {}", fmt::join(arguments, " "));
    return statusOf(
        [&] {
            toml::table config;
            if (!given.config.empty()) {
                config = readConfig(given.config);
                applyConfig(config, given.config, command, line.app);
            }
            std::optional<Preset> preset;
            if (command.get_option_no_throw("--preset")) preset = presetOf(given, config);
            run(given.finish(given.common, preset ? &*preset : nullptr));
        },
        err);
}

}  // namespace doppel
