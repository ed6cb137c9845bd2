// `doppel completion`: what shells complete after `doppel`.
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>

#include "trainer/commands/command.h"
#include "trainer/commands/manual/words.h"

namespace doppel {

namespace {

std::string replaced(std::string text, const std::string& what, const std::string& by) {
    for (size_t at = 0; (at = text.find(what, at)) != text.npos; at += by.size())
        text.replace(at, what.size(), by);
    return text;
}

// In single quotes, as bash and zsh read it.
std::string quoted(const std::string& text) { return "'" + replaced(text, "'", "'\\''") + "'"; }

std::vector<std::string> optionNames(const CommandWords& command) {
    std::vector<std::string> names;
    for (const OptionWords& option : command.options)
        if (!option.positional) names.insert(names.end(), option.names.begin(), option.names.end());
    return names;
}

bool positionalsAreFiles(const CommandWords& command) {
    return std::ranges::any_of(command.options, [](const auto& option) {
        return option.positional && option.takesFile();
    });
}

std::vector<std::string> positionalChoices(const CommandWords& command) {
    for (const OptionWords& option : command.options)
        if (option.positional && !option.choices.empty()) return option.choices;
    return {};
}

std::string bashCompletion(const std::vector<CommandWords>& commands) {
    std::vector<std::string> names;
    std::string cases;
    for (const CommandWords& command : commands) {
        names.push_back(command.name);
        // What follows an option: its words, a file, or something that nobody can guess.
        std::string values, free;
        std::vector<std::string> files;
        for (const OptionWords& option : command.options) {
            if (option.positional || option.type.empty()) continue;
            const std::string pattern = fmt::format("{}", fmt::join(option.names, " | "));
            if (!option.choices.empty())
                values += fmt::format("        {}) words={} ;;\n", pattern,
                                      quoted(fmt::format("{}", fmt::join(option.choices, " "))));
            else if (option.takesFile())
                files.push_back(pattern);
            else
                free += (free.empty() ? "" : " | ") + pattern;
        }
        if (!files.empty())
            values += fmt::format("        {}) files=1 ;;\n", fmt::join(files, " | "));
        if (!free.empty()) values += fmt::format("        {}) return ;;\n", free);
        cases += fmt::format(
            "    {}) case $before in\n{}        *) options={} words={} files={} ;;\n"
            "        esac ;;\n",
            command.name, values, quoted(fmt::format("{}", fmt::join(optionNames(command), " "))),
            quoted(fmt::format("{}", fmt::join(positionalChoices(command), " "))),
            positionalsAreFiles(command) ? "1" : "");
    }
    return fmt::format(R"(# bash completion of doppel, written by `doppel completion bash`.
_doppel() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}}
    local options= words= files=
    COMPREPLY=()
    # --flag=value comes as three words.
    if [[ $word == = ]]; then
        word=
    elif [[ $before == = && $COMP_CWORD -gt 2 ]]; then
        before=${{COMP_WORDS[COMP_CWORD - 2]}}
    fi
    if [[ $COMP_CWORD -eq 1 ]]; then
        mapfile -t COMPREPLY < <(compgen -W {0} -- "$word")
        return
    fi
    case ${{COMP_WORDS[1]}} in
{1}    esac
    if [[ $word == -* ]]; then
        words=$options files=
    fi
    if [[ $words ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
    elif [[ $files ]]; then
        # bash itself completes names of files, with whatever they hold.
        compopt -o default 2>/dev/null
    fi
}}
complete -F _doppel doppel
)",
                       quoted(fmt::format("{} --help --version", fmt::join(names, " "))), cases);
}

// Within a specification of _arguments, in single quotes.
std::string zshText(std::string text) {
    for (const char* special : {"\\", "[", "]", ":"})
        text = replaced(text, special, std::string("\\") + special);
    return replaced(text, "'", "'\\''");
}

std::string zshValue(const OptionWords& option) {
    const std::string what = zshText(option.type.empty() ? "value" : option.type);
    if (!option.choices.empty())
        return fmt::format(":{}:({})", what,
                           zshText(fmt::format("{}", fmt::join(option.choices, " "))));
    return fmt::format(":{}:{}", what, option.takesFile() ? "_files" : " ");
}

std::string zshCompletion(const std::vector<CommandWords>& commands) {
    std::string list, cases;
    for (const CommandWords& command : commands) {
        list += fmt::format("        '{}:{}'\n", command.name, zshText(command.summary));
        cases += fmt::format("    {}) _arguments", command.name);
        int position = 0;
        for (const OptionWords& option : command.options) {
            if (option.positional) {
                cases += fmt::format(" \\\n        '{}{}'", ++position, zshValue(option));
                continue;
            }
            for (const std::string& name : option.names)
                cases += fmt::format(" \\\n        '*{}{}[{}]{}'", name,
                                     option.type.empty() ? "" : "=", zshText(option.description),
                                     option.type.empty() ? "" : zshValue(option));
        }
        cases += " ;;\n";
    }
    return fmt::format(R"(#compdef doppel
# zsh completion of doppel, written by `doppel completion zsh`.
_doppel() {{
    local -a commands
    commands=(
{0}    )
    if (( CURRENT == 2 )); then
        _describe command commands
        return
    fi
    shift words
    (( CURRENT-- ))
    case $words[1] in
{1}    esac
}}
# Found on the fpath this file is the function itself; sourced it declares one.
if [[ $funcstack[1] == _doppel ]]; then
    _doppel "$@"
else
    compdef _doppel doppel
fi
)",
                       list, cases);
}

std::string fishText(std::string text) {
    return "'" + replaced(replaced(std::move(text), "\\", "\\\\"), "'", "\\'") + "'";
}

std::string fishCompletion(const std::vector<CommandWords>& commands) {
    std::string text =
        "# fish completion of doppel, written by `doppel completion fish`.\n"
        "complete -c doppel -f\n"
        "complete -c doppel -n __fish_use_subcommand -l help -d 'Print help'\n"
        "complete -c doppel -n __fish_use_subcommand -l version -d 'Print the version'\n";
    for (const CommandWords& command : commands) {
        text += fmt::format("complete -c doppel -n __fish_use_subcommand -a {} -d {}\n",
                            command.name, fishText(command.summary));
        const std::string within =
            fmt::format("complete -c doppel -n '__fish_seen_subcommand_from {}'", command.name);
        if (positionalsAreFiles(command)) text += within + " -F\n";
        if (auto words = positionalChoices(command); !words.empty())
            text += fmt::format("{} -a {}\n", within,
                                fishText(fmt::format("{}", fmt::join(words, " "))));
        for (const OptionWords& option : command.options) {
            if (option.positional) continue;
            text += within;
            for (const std::string& name : option.names)
                text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
            if (!option.type.empty()) {
                if (!option.choices.empty())
                    text += " -x -a " + fishText(fmt::format("{}", fmt::join(option.choices, " ")));
                else
                    text += option.takesFile() ? " -r -F" : " -x";
            }
            text += fmt::format(" -d {}\n", fishText(option.description));
        }
    }
    return text;
}

struct CompletionOptions {
    CommonOptions common;
    std::string shell;
};

void runCompletion(const CompletionOptions& options) {
    const std::vector<CommandWords> commands = commandWords();
    fmt::print("{}", options.shell == "bash"  ? bashCompletion(commands)
                     : options.shell == "zsh" ? zshCompletion(commands)
                                              : fishCompletion(commands));
}

const Command<CompletionOptions> kCompletion{{
    .name = "completion",
    .place = 120,
    .summary = "Print what completes doppel's command line in bash, zsh or fish",
    .description =
        "Prints a shell's completion of doppel, which an installed doppel brings along:\n"
        "`source <(doppel completion bash)` has it in one shell.",
    .example = "doppel completion bash > ~/.local/share/bash-completion/completions/doppel",
    .flags =
        [](CommandFlags& flags, CompletionOptions& o) {
            flags->add_option("SHELL", o.shell, "Whose completion")
                ->required()
                ->check(CLI::IsMember({"bash", "zsh", "fish"}));
        },
    .run = runCompletion,
}};

}  // namespace

}  // namespace doppel
