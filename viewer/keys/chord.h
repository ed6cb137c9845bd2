// A key, a drag or the wheel, with what is held meanwhile.
#pragma once

#include <compare>
#include <optional>
#include <string>
#include <string_view>

namespace doppel {

// Keys have GLFW's numbers, those that print something the number of what stands on them: 'Z' is
// where the keyboard's own layout has it (Window::keys). What is no key has these.
constexpr int kDigit = 1000;  // 1 to 9, of which each means another thing
constexpr int kLeftDrag = 1001, kMiddleDrag = 1002, kRightDrag = 1003;
constexpr int kWheel = 1004, kSidewaysWheel = 1005;

struct Chord {
    int code = 0;
    int modifiers = 0;  // GLFW's bits of Ctrl, Shift and Alt
    auto operator<=>(const Chord&) const = default;
    bool isMouse() const { return code >= kLeftDrag; }
};

// Of a key press or a mouse's event. Super counts as Ctrl; what is locked does not count.
Chord chordOf(int code, int modifiers);

// "Ctrl + Shift + Z", "Alt + left drag", "Numpad .", "Ctrl + plus"; and back, in capitals or not.
std::string textOf(const Chord& chord);
std::optional<Chord> readChord(std::string_view text);

}  // namespace doppel
