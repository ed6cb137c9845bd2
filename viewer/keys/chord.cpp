#include "viewer/keys/chord.h"

#include <GLFW/glfw3.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace doppel {

namespace {

constexpr std::array<std::pair<int, const char*>, 3> kModifiers{
    {{GLFW_MOD_CONTROL, "Ctrl"}, {GLFW_MOD_SHIFT, "Shift"}, {GLFW_MOD_ALT, "Alt"}}};

const std::vector<std::pair<int, std::string>>& keyNames() {
    static const std::vector<std::pair<int, std::string>> kNames = [] {
        std::vector<std::pair<int, std::string>> names{{GLFW_KEY_SPACE, "Space"},
                                                       {GLFW_KEY_ENTER, "Enter"},
                                                       {GLFW_KEY_TAB, "Tab"},
                                                       {GLFW_KEY_ESCAPE, "Escape"},
                                                       {GLFW_KEY_BACKSPACE, "Backspace"},
                                                       {GLFW_KEY_DELETE, "Delete"},
                                                       {GLFW_KEY_INSERT, "Insert"},
                                                       {GLFW_KEY_HOME, "Home"},
                                                       {GLFW_KEY_END, "End"},
                                                       {GLFW_KEY_PAGE_UP, "Page up"},
                                                       {GLFW_KEY_PAGE_DOWN, "Page down"},
                                                       {GLFW_KEY_LEFT, "left"},
                                                       {GLFW_KEY_RIGHT, "right"},
                                                       {GLFW_KEY_UP, "up"},
                                                       {GLFW_KEY_DOWN, "down"},
                                                       {'+', "plus"},
                                                       {'-', "minus"},
                                                       {'\\', "backslash"},
                                                       {'"', "quotation mark"},
                                                       {GLFW_KEY_KP_DECIMAL, "Numpad ."},
                                                       {GLFW_KEY_KP_ADD, "Numpad +"},
                                                       {GLFW_KEY_KP_SUBTRACT, "Numpad -"},
                                                       {GLFW_KEY_KP_MULTIPLY, "Numpad *"},
                                                       {GLFW_KEY_KP_DIVIDE, "Numpad /"},
                                                       {GLFW_KEY_KP_ENTER, "Numpad Enter"},
                                                       {kDigit, "digit"},
                                                       {kLeftDrag, "left drag"},
                                                       {kMiddleDrag, "middle drag"},
                                                       {kRightDrag, "right drag"},
                                                       {kWheel, "wheel"},
                                                       {kSidewaysWheel, "wheel sideways"}};
        for (int i = 0; i < 12; ++i) names.emplace_back(GLFW_KEY_F1 + i, fmt::format("F{}", i + 1));
        for (int i = 0; i < 10; ++i)
            names.emplace_back(GLFW_KEY_KP_0 + i, fmt::format("Numpad {}", i));
        for (int code = '!'; code <= '~'; ++code) {
            const bool small = code >= 'a' && code <= 'z';
            if (!small && std::ranges::count(names, code, &std::pair<int, std::string>::first) == 0)
                names.emplace_back(code, std::string(1, static_cast<char>(code)));
        }
        return names;
    }();
    return kNames;
}

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

bool sameWord(std::string_view a, std::string_view b) {
    return std::ranges::equal(a, b, {}, lower, lower);
}

std::string_view trimmed(std::string_view text) {
    while (text.starts_with(' ')) text.remove_prefix(1);
    while (text.ends_with(' ')) text.remove_suffix(1);
    return text;
}

}  // namespace

Chord chordOf(int code, int modifiers) {
    if (modifiers & GLFW_MOD_SUPER) modifiers |= GLFW_MOD_CONTROL;
    return {code, modifiers & (GLFW_MOD_CONTROL | GLFW_MOD_SHIFT | GLFW_MOD_ALT)};
}

std::string textOf(const Chord& chord) {
    std::string text;
    for (const auto& [bit, name] : kModifiers)
        if (chord.modifiers & bit) text += fmt::format("{} + ", name);
    const auto found =
        std::ranges::find(keyNames(), chord.code, &std::pair<int, std::string>::first);
    return text + (found == keyNames().end() ? fmt::format("key {}", chord.code) : found->second);
}

std::optional<Chord> readChord(std::string_view text) {
    Chord chord;
    std::string_view rest = trimmed(text);
    for (bool found = true; found;) {
        found = false;
        for (const auto& [bit, name] : kModifiers) {
            const size_t length = std::string_view(name).size();
            if (!sameWord(rest.substr(0, length), name)) continue;
            const std::string_view after = trimmed(rest.substr(length));
            if (!after.starts_with('+')) continue;
            chord.modifiers |= bit;
            rest = trimmed(after.substr(1));
            found = true;
        }
    }
    for (const auto& [code, name] : keyNames())
        if (sameWord(rest, name) || (code < kDigit && rest.size() == 1 && rest[0] == code)) {
            chord.code = code;
            return chord;
        }
    return std::nullopt;
}

}  // namespace doppel
