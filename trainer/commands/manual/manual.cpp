// `doppel manual`: the commands' help as manual pages.
#include <fmt/ranges.h>

#include <cctype>

#include "engine/files/atomic_file.h"
#include "trainer/commands/cli.h"
#include "trainer/commands/command.h"
#include "trainer/commands/manual/words.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/version.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Text as roff reads it: what is special in it is named, `code` is bold, and no line begins with
// what would be a request.
std::string roff(const std::string& text) {
    std::string out;
    bool bold = false;
    for (char c : text) {
        if (c == '`') {
            bold = !bold;
            out += bold ? "\\fB" : "\\fR";
            continue;
        }
        if ((out.empty() || out.back() == '\n') && (c == '.' || c == '\'')) out += "\\&";
        if (c == '\\')
            out += "\\e";
        else if (c == '-')
            out += "\\-";
        else if (c == '\'')
            out += "\\(aq";
        else
            out += c;
    }
    return out;
}

std::string bold(const std::string& text) { return "\\fB" + roff(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + roff(text) + "\\fR"; }

std::string upper(std::string text) {
    for (char& c : text) c = char(std::toupper(static_cast<unsigned char>(c)));
    return text;
}

// A sentence with its full stop.
std::string sentence(const std::string& text) {
    return text.empty() || text.back() == '.' ? text : text + ".";
}

std::string heading(const std::string& page) {
    return fmt::format(".\\\" Written by `doppel manual`.\n.TH {} 1 \"\" \"doppel {}\" Doppel\n",
                       roff(upper(page)), kVersion);
}

std::string example(const std::string& lines) {
    return fmt::format(".PP\n.RS 4\n.nf\n{}\n.fi\n.RE\n", roff(lines));
}

std::string usageOf(const OptionWords& option) {
    std::string usage = option.positional ? italic(option.names[0]) : std::string();
    if (!option.positional) {
        for (const std::string& name : option.names)
            usage += (usage.empty() ? "" : ", ") + bold(name);
        if (!option.type.empty()) usage += " " + italic(option.type);
    }
    return usage;
}

std::string paragraphOf(const OptionWords& option) {
    std::string text = roff(sentence(option.description));
    if (!option.choices.empty())
        text +=
            fmt::format("\nOne of {}.", roff(fmt::format("{}", fmt::join(option.choices, ", "))));
    if (!option.range.empty()) text += fmt::format("\nExpected {}.", roff(option.range));
    if (!option.fallback.empty()) text += fmt::format("\nWithout it: {}.", bold(option.fallback));
    if (option.required && !option.positional) text += "\nIt has to be given.";
    return fmt::format(".TP\n{}\n{}\n", usageOf(option), text);
}

std::string pageOf(const CommandWords& command) {
    const std::string page = "doppel-" + command.name;
    std::string text = heading(page);
    text += fmt::format(".SH NAME\n{} \\- {}\n", roff(page), roff(command.summary));
    text += fmt::format(".SH SYNOPSIS\n{}", bold("doppel " + command.name));
    for (const OptionWords& option : command.options)
        if (option.positional)
            text += option.required ? " " + usageOf(option) : fmt::format(" [{}]", usageOf(option));
        else if (option.required)
            text += " " + usageOf(option);
    text += fmt::format(" [{}]\n", italic("OPTIONS"));
    text += fmt::format(
        ".SH DESCRIPTION\n{}\n",
        roff(sentence(command.description.empty() ? command.summary : command.description)));
    std::string group;
    for (const OptionWords& option : command.options) {
        const std::string of = option.positional ? "Arguments" : option.group;
        if (of != group) {
            group = of;
            text +=
                fmt::format(".SH {}\n", group == "Common" ? "\"COMMON OPTIONS\"" : upper(group));
        }
        text += paragraphOf(option);
    }
    text += fmt::format(".SH EXAMPLE\n{}", example(command.example));
    text += fmt::format(".SH \"EXIT STATUS\"\n{}\n", roff(exitStatusText()));
    return text + ".SH \"SEE ALSO\"\n.BR doppel (1)\n";
}

std::string pageOfAll(const std::vector<CommandWords>& commands) {
    std::string text = heading("doppel");
    withCommandLine([&](const CLI::App& app) {
        text += ".SH NAME\ndoppel \\- make a controllable avatar of a recorded person\n";
        text += fmt::format(".SH SYNOPSIS\n{} {} [{}]\n.PP\n{} {} {}\n", bold("doppel"),
                            italic("COMMAND"), italic("OPTIONS"), bold("doppel"), italic("COMMAND"),
                            bold("--help"));
        text += fmt::format(".SH DESCRIPTION\n{}\n", roff(app.get_description()));
    });
    text += ".SH COMMANDS\n";
    for (const CommandWords& command : commands)
        text += fmt::format(".TP\n{}(1)\n{}\n", bold("doppel-" + command.name),
                            roff(sentence(command.summary)));
    text += ".SH EXAMPLES\n";
    for (const auto& [what, lines] : exampleTexts())
        text += fmt::format(".PP\n{}\n{}", roff(what), example(lines));
    text += fmt::format(".SH \"EXIT STATUS\"\n{}\n", roff(exitStatusText()));
    text += ".SH \"SEE ALSO\"\n";
    for (size_t i = 0; i < commands.size(); ++i)
        text += fmt::format(".BR {} (1){}\n", roff("doppel-" + commands[i].name),
                            i + 1 < commands.size() ? "," : "");
    return text;
}

struct ManualOptions {
    CommonOptions common;
    fs::path out;
};

void runManual(const ManualOptions& options) {
    OutputFolder folder(options.out, "manual");
    const auto write = [&](const std::string& page, const std::string& text) {
        AtomicFile file(folder.folder() / (page + ".1"));
        file.write(text);
        file.commit();
    };
    const std::vector<CommandWords> commands = commandWords();
    write("doppel", pageOfAll(commands));
    for (const CommandWords& command : commands) write("doppel-" + command.name, pageOf(command));
    folder.commit();
    fmt::print("{}: {} manual pages\n", options.out.string(), commands.size() + 1);
}

const Command<ManualOptions> kManual{{
    .name = "manual",
    .place = 130,
    .summary = "Write the manual pages",
    .description = "Writes doppel's manual pages, one for each command, which an installed doppel\n"
                   "brings along. `man -l FILE` shows one.",
    .example = "doppel manual --out man && man -l man/doppel-train.1",
    .flags = [](CommandFlags& flags,
                ManualOptions& o) { flags.path("--out", o.out, "Folder to write")->required(); },
    .run = runManual,
}};

}  // namespace

}  // namespace doppel
