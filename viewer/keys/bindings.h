// Which keys, drags and turns of the wheel do what: one of two presets, or a file of the user's.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "viewer/keys/action.h"
#include "viewer/keys/chord.h"

namespace doppel {

class Bindings {
public:
    // "gltf": the habits of glTF viewers in browsers; "blender": Blender's. InputError otherwise,
    // which says what `what` is expected to be.
    static Bindings preset(std::string_view name, const std::string& what = "keys");
    static bool isPreset(std::string_view name);
    // A preset's name or a file's.
    static Bindings named(const std::string& nameOrFile);
    // TOML: `preset = "blender"`, and for actions (action.h) a chord (chord.h) or a list of them:
    // `play = ["Space", "Shift + P"]`. What is not named is as in the preset, without "preset" as
    // in gltf; chords that the file gives to one action are taken from the preset's others.
    // InputError, with the line, for what is something else, and for a chord that has two meanings.
    static Bindings read(const std::filesystem::path& file);
    // All of them in that form, each with what it does.
    std::string text() const;

    // Of a preset, or the file's as it was given.
    const std::string& name() const { return name_; }
    const std::vector<Chord>& of(Action action) const {
        return chords_[static_cast<size_t>(action)];
    }
    // Of a key's chord its own action before the one that takes any digit.
    std::optional<Action> actionOf(const Chord& chord) const;

    // "F, Numpad ."; the first alone. Empty where there is none.
    std::string keysOf(Action action) const;
    std::string keyOf(Action action) const;
    // A tip with the first key: "Plays the timeline (Space)."
    std::string tip(std::string_view does, Action action) const;

    // The wheel as two fingers on a touchpad: orbit, with Shift pan, with Ctrl nearer and farther.
    void useTouchpad();

private:
    void set(Action action, std::vector<Chord> chords) {
        chords_[static_cast<size_t>(action)] = std::move(chords);
    }

    std::string name_;
    std::array<std::vector<Chord>, kActions> chords_;
};

}  // namespace doppel
