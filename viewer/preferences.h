// What the viewer remembers from one start to the next.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "viewer/settings.h"
#include "viewer/window/look.h"
#include "viewer/window/window.h"

namespace doppel {

// A view to come back to.
struct Bookmark {
    std::string name;
    std::string camera;  // as cameraText()
    bool operator==(const Bookmark&) const = default;
};
constexpr int kMostBookmarks = 9;
constexpr size_t kLongestBookmark = 60;  // bytes of its name

struct Preferences {
    std::vector<std::string> recent;  // files that were opened, the latest first
    Theme theme = Theme::Dark;
    double scale = 1;                   // of the interface
    bool snap = false;                  // rings turn by steps unless Ctrl is held, not if it is
    std::string keys = "gltf";          // a preset or a file, as Bindings::named() takes it
    bool undoCamera = false;            // undo brings the camera back as well
    bool touchpad = false;              // Bindings::useTouchpad()
    std::map<int, Bookmark> bookmarks;  // by the digit that brings them back, 1 to 9
    bool operator==(const Preferences&) const = default;
};

constexpr double kSmallestScale = .5, kLargestScale = 4;

// Those in `state`; what is missing there, or damaged, is as nobody had chosen it. state: empty:
// nobody has.
Preferences readPreferences(const std::filesystem::path& state);
// Nothing where `state` is empty, and where it cannot be written: they are not worth an error.
void writePreferences(const std::filesystem::path& state, const Preferences& preferences);

// The viewer's: as the options have it, else as it was chosen before.
WindowOptions windowOptions(const ViewerOptions& options, const Preferences& preferences);

// Puts the file first, and forgets those that were opened longest ago.
void remember(Preferences& preferences, const std::filesystem::path& file);

}  // namespace doppel
