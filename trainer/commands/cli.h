// The command line of `doppel`: what is typed, on top of what a config file says, as options.
#pragma once

#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#include "trainer/commands/command.h"

namespace doppel {

// arguments: without the program's name. Returns the exit status: 0 done; 1 it failed; 2 the input
// or the flags are wrong; 130 interrupted (143, 129 by SIGTERM, SIGHUP). Whatever fails prints one
// line on `err`, help goes to `out`. run: what is done with the command that was asked for; tests
// look at its options instead.
//
// A config file (--config FILE, TOML) holds long options as keys (device = "llvmpipe", seed = 7,
// stages = ["fit", "mesh"]) and a preset's numbers in tables ([mesh] batch = 8). One file can serve
// all subcommands: keys that another one knows are left alone, keys that none knows are refused.
// Flags win over the file, the file over the preset.
int runCommandLine(
    const std::vector<std::string>& arguments, std::ostream& out, std::ostream& err,
    const std::function<void(const ParsedCommand&)>& run = [](const ParsedCommand& command) {
        command.run();
    });

// For what is written of the commands elsewhere: all their flags, declared and never parsed.
void withCommandLine(const std::function<void(const CLI::App& app)>& use);
// What a few command lines do, and they, a line each.
struct ExampleText {
    const char *what, *lines;
};
std::vector<ExampleText> exampleTexts();
const char* exitStatusText();

}  // namespace doppel
