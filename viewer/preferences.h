// What the viewer remembers from one start to the next.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "viewer/window/look.h"

namespace doppel {

struct Preferences {
    std::vector<std::string> recent;  // files that were opened, the latest first
    Theme theme = Theme::Dark;
    double scale = 1;  // of the interface
    bool operator==(const Preferences&) const = default;
};

constexpr double kSmallestScale = .5, kLargestScale = 4;

// Those in `state`; what is missing there, or damaged, is as nobody had chosen it. state: empty:
// nobody has.
Preferences readPreferences(const std::filesystem::path& state);
// Nothing where `state` is empty, and where it cannot be written: they are not worth an error.
void writePreferences(const std::filesystem::path& state, const Preferences& preferences);

// Puts the file first, and forgets those that were opened longest ago.
void remember(Preferences& preferences, const std::filesystem::path& file);

}  // namespace doppel
