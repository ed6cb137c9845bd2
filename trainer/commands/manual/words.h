// What the commands' flags declare, as manual pages and completions need it.
#pragma once

#include <string>
#include <vector>

#include "trainer/commands/command.h"

namespace doppel {

struct OptionWords {
    std::vector<std::string> names;    // "--out"; of a positional one "CAPTURE"
    std::string type;                  // "PATH", "NUMBER"; empty: a flag, which takes nothing
    std::string range;                 // "from 1 to 256", "0 or more"; may be empty
    std::vector<std::string> choices;  // all that it takes; empty: anything
    std::string fallback, description;
    std::string group;  // "Options", "Common"
    bool positional = false, required = false;

    bool takesFile() const;
};

struct CommandWords {
    std::string name, summary, description, example;
    std::vector<OptionWords> options;  // positional ones first, common ones last
};

// Of all commands, in help's order.
std::vector<CommandWords> commandWords();

}  // namespace doppel
