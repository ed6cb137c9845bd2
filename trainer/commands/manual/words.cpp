#include "trainer/commands/manual/words.h"

#include <algorithm>

#include "trainer/commands/cli.h"

namespace doppel {

namespace {

std::vector<std::string> split(const std::string& text, char at) {
    std::vector<std::string> parts(1);
    for (char c : text) {
        if (c == at)
            parts.emplace_back();
        else
            parts.back() += c;
    }
    return parts;
}

// What CLI11 shows of a validator: "INT in [1 - 256]", "NONNEGATIVE".
std::string rangeOf(const std::string& check) {
    if (check == "NONNEGATIVE") return "0 or more";
    if (check == "POSITIVE") return "more than 0";
    const size_t open = check.find(" in ["), close = check.rfind(']');
    if (open == check.npos || close == check.npos) return {};
    std::string range = check.substr(open + 5, close - open - 5);
    const size_t dash = range.find(" - ");
    if (dash == range.npos) return {};
    return "from " + range.replace(dash, 3, " to ");
}

OptionWords wordsOf(const CLI::Option& option) {
    OptionWords words;
    words.positional = option.get_positional();
    words.required = option.get_required();
    words.description = option.get_description();
    words.group = option.get_group();
    words.fallback = option.get_default_str();
    if (words.fallback.starts_with('[') && words.fallback.ends_with(']'))  // of a list
        words.fallback = words.fallback.substr(1, words.fallback.size() - 2);
    if (words.positional) words.names.push_back(option.get_name(true));
    for (const std::string& name : option.get_snames()) words.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames()) words.names.push_back("--" + name);
    // CLI11 joins the type and what its validators say with colons: TEXT:{fp32,mixed}.
    const std::vector<std::string> parts = split(option.get_type_name(), ':');
    for (size_t i = 1; i < parts.size(); ++i) {
        const std::string& part = parts[i];
        if (part.size() > 1 && part.front() == '{' && part.back() == '}')
            words.choices = split(part.substr(1, part.size() - 2), ',');
        else if (std::string range = rangeOf(part); !range.empty())
            words.range = range;
    }
    if (option.get_items_expected_min() == 0 && !words.positional) {
        words.fallback.clear();  // a flag's own true and false
        return words;
    }
    words.type = parts[0];
    if (words.type == "INT" || words.type == "UINT" || words.type == "FLOAT") words.type = "NUMBER";
    return words;
}

}  // namespace

bool OptionWords::takesFile() const {
    return type.find("PATH") != type.npos || type.find("FILE") != type.npos;
}

std::vector<CommandWords> commandWords() {
    std::vector<CommandWords> all;
    withCommandLine([&](const CLI::App& app) {
        for (const CommandEntry& entry : CommandEntry::all()) {
            CommandWords command{entry.name, entry.summary, entry.description, entry.example, {}};
            for (const CLI::Option* option : app.get_subcommand(entry.name)->get_options())
                command.options.push_back(wordsOf(*option));
            std::ranges::stable_sort(command.options, {}, [](const OptionWords& option) {
                return option.positional ? 0 : option.group == "Common" ? 2 : 1;
            });
            all.push_back(std::move(command));
        }
    });
    return all;
}

}  // namespace doppel
