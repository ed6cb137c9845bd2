// For options whose own sentence refuses words that they do not know; CLI::IsMember brings its own.
#pragma once

#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace doppel {

// Help, manual and completion show these words. Refuses nothing.
inline CLI::Validator showsChoices(const std::vector<std::string>& words) {
    return {[](std::string&) { return std::string(); },
            fmt::format("{{{}}}", fmt::join(words, ","))};
}

}  // namespace doppel
