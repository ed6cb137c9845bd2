// Widgets that several parts of the window share.
#pragma once

#include <imgui.h>

#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "viewer/drawn_items.h"
#include "viewer/window/look.h"
#include "viewer/window/window.h"

namespace doppel {

// Of what is written over the picture.
struct StatusColours {
    ImU32 backing, plain, good, bad;
};
StatusColours statusColours(Theme theme);

// Of the item before. words: what has to fit into its frame besides the padding; empty: nothing.
void noteItem(std::string_view label, std::string_view words = {}, float besides = 0);

// Of the row of a list before, which reaches beyond its words to both sides.
void noteRow(std::string_view label);

// Says what the item before does, once the mouse has rested on it for a moment; empty: nothing.
void tip(std::string_view text);
// The same of a part of the window that is no item: where the mouse is over it.
void tipOver(std::string_view text, ImVec2 low, ImVec2 high);

bool button(const char* label, const std::string& does, bool enabled = true);
bool checkbox(const char* label, const std::string& does, bool& value);
bool slider(const char* label, const std::string& does, int& value, int low, int high,
            const char* format);
bool slider(const char* label, const std::string& does, double& value, double low, double high,
            const char* format);
void words(const std::string& text);  // wrapped
void hint(const std::string& text);   // wrapped, dimmed
// With EndTabItem where it is true. show: it comes to the front.
bool tab(const char* label, const std::string& does, bool show = false);
// For the name of a file or folder, as wide as there is room; whether Enter was pressed in it.
// keys: of the frame.
bool pathField(const std::string& does, std::span<char> text, std::span<const KeyPress> keys);
// What was typed; a ~ before it is the user's home folder, as in a shell.
std::filesystem::path typedPath(std::span<const char> text);

struct Choice {
    const char* name;
    int value;
    std::string_view does = {};  // the tip's; empty: its name says it
};
// True where another one was chosen.
bool choose(const char* label, const std::string& does, const Choice* choices, size_t count,
            int& value);
template <size_t N>
bool choose(const char* label, const std::string& does, const Choice (&choices)[N], int& value) {
    return choose(label, does, choices, N, value);
}

// The next item goes beside the one before where so much more is free, else below.
void beside(const char* nextLabel);

constexpr ImGuiWindowFlags kFixed = ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize |
                                    ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoTitleBar |
                                    ImGuiWindowFlags_NoBringToFrontOnFocus |
                                    ImGuiWindowFlags_NoSavedSettings;

}  // namespace doppel
