// Which keys do what: chords as texts, the presets, files of the user's.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include "engine/error.h"
#include "tests/files.h"
#include "viewer/keys/bindings.h"

namespace doppel::test {
namespace {

namespace fs = std::filesystem;

void write(const fs::path& file, const std::string& text) { std::ofstream(file) << text; }

// What is wrong with a file of this text; empty: nothing.
std::string refusal(const std::string& text) {
    const Folder folder;
    write(folder / "keys.toml", text);
    try {
        Bindings::read(folder / "keys.toml");
    } catch (const InputError& error) {
        const std::string sentence = error.what();
        const size_t name = sentence.find("keys.toml");
        return name == std::string::npos ? "no file in: " + sentence : sentence.substr(name);
    }
    return {};
}

std::vector<std::string> textsOf(const Bindings& bindings, Action action) {
    std::vector<std::string> texts;
    for (const Chord& chord : bindings.of(action)) texts.push_back(textOf(chord));
    return texts;
}

TEST(Bindings, ChordsAreTexts) {
    for (const char* text :
         {"Space", "Ctrl + Shift + Z", "Alt + left drag", "Numpad .", "Numpad +", "Ctrl + plus",
          "Shift + wheel", "wheel sideways", "F12", "Ctrl + digit", "minus", "[", "Page up"}) {
        const auto chord = readChord(text);
        ASSERT_TRUE(chord) << text;
        EXPECT_EQ(textOf(*chord), text);
    }
    EXPECT_EQ(readChord("shift+CTRL +z"), readChord("Ctrl + Shift + Z"));
    EXPECT_EQ(readChord("Ctrl + +"), readChord("Ctrl + plus"));
    for (const char* text : {"", "Spaec", "Ctrl", "Ctrl +", "Hyper + A", "left + drag", "ZZ"})
        EXPECT_FALSE(readChord(text)) << text;
}

TEST(Bindings, PresetsGiveEachChordOneMeaningAndTheMouseWhatItNeeds) {
    for (const char* name : {"gltf", "blender"}) {
        const Bindings bindings = Bindings::preset(name);
        std::set<Chord> seen;
        for (size_t i = 0; i < kActions; ++i) {
            const auto action = static_cast<Action>(i);
            for (const Chord& chord : bindings.of(action)) {
                EXPECT_TRUE(seen.insert(chord).second) << name << ": " << textOf(chord);
                EXPECT_EQ(chord.isMouse(), infoOf(action).trigger == Trigger::Mouse);
                EXPECT_EQ(chord.code == kDigit, infoOf(action).trigger == Trigger::Digit);
            }
            EXPECT_EQ(actionNamed(infoOf(action).name), action);
        }
        // Nobody needs a third button, nor a number pad.
        for (Action action : {Action::Orbit, Action::Pan, Action::Zoom})
            EXPECT_TRUE(std::ranges::any_of(bindings.of(action),
                                            [](const Chord& c) { return c.code == kLeftDrag; }))
                << name << ": " << infoOf(action).name;
        for (Action action : {Action::FrameSelected, Action::Front, Action::Help, Action::Cancel})
            EXPECT_TRUE(std::ranges::any_of(
                bindings.of(action),
                [](const Chord& c) { return !textOf(c).starts_with("Numpad"); }))
                << name << ": " << infoOf(action).name;
    }
    EXPECT_THROW(Bindings::preset("maya"), InputError);
}

TEST(Bindings, AFileHasAllOfThemOrSome) {
    const Folder folder;
    const fs::path file = folder / "keys.toml";
    for (const char* name : {"gltf", "blender"}) {
        const Bindings preset = Bindings::preset(name);
        write(file, preset.text());
        const Bindings read = Bindings::read(file);
        for (size_t i = 0; i < kActions; ++i)
            EXPECT_EQ(read.of(static_cast<Action>(i)), preset.of(static_cast<Action>(i)))
                << infoOf(static_cast<Action>(i)).name;
        EXPECT_EQ(read.name(), file.string());
    }
    write(file, "preset = \"blender\"\nplay = \"G\"\npin = [\"Q\", \"Shift + Q\"]\nfilm = []\n");
    const Bindings read = Bindings::named(file.string());
    EXPECT_EQ(textsOf(read, Action::Play), std::vector<std::string>{"G"});
    EXPECT_EQ(textsOf(read, Action::Pin), (std::vector<std::string>{"Q", "Shift + Q"}));
    EXPECT_TRUE(read.of(Action::Film).empty());
    EXPECT_TRUE(read.of(Action::Grab).empty()) << "it had G, which plays now";
    EXPECT_EQ(textsOf(read, Action::Rotate), std::vector<std::string>{"R"});
    EXPECT_EQ(read.tip("Pins it", Action::Pin), "Pins it (Q).");
    EXPECT_EQ(read.tip("Films", Action::Film), "Films.");
}

TEST(Bindings, ARefusalNamesFileLineAndWhatWasExpected) {
    EXPECT_EQ(refusal("# mine\nplya = \"G\"\n"),
              "keys.toml: line 2: expected preset or an action, such as play, found \"plya\"");
    EXPECT_EQ(refusal("play = \"Spaec\"\n"),
              "keys.toml: line 1: play: expected a key, such as \"Space\", \"Ctrl + Shift + Z\" or "
              "\"Numpad .\", found \"Spaec\"");
    EXPECT_EQ(refusal("\nplay = \"left drag\"\n").substr(0, 38),
              "keys.toml: line 2: play: expected a ke");
    EXPECT_EQ(refusal("orbit = \"O\"\n"),
              "keys.toml: line 1: orbit: expected a drag or the wheel, such as \"Alt + left drag\" "
              "or \"Shift + wheel\", found \"O\"");
    EXPECT_EQ(refusal("see-view = \"Ctrl + 1\"\n"),
              "keys.toml: line 1: see-view: expected what is held with a digit, such as \"Ctrl + "
              "digit\", found \"Ctrl + 1\"");
    EXPECT_EQ(refusal("play = \"G\"\npin = [\"P\",\n  \"g\"]\n"),
              "keys.toml: line 1: play: expected a chord that nothing else has, found \"G\", which "
              "line 3 gives to pin");
    EXPECT_EQ(refusal("preset = \"maya\"\n"),
              "keys.toml: line 1: preset: expected \"gltf\" or \"blender\", found \"maya\"");
    EXPECT_NE(refusal("play = 5\n").find("line 1: play: expected a key"), std::string::npos);
    EXPECT_NE(refusal("play = \n").find("line 1: not TOML"), std::string::npos);
    EXPECT_EQ(refusal("play = \"G\"\n"), "");
    EXPECT_THROW(Bindings::named("no-such-keys"), InputError);
}

TEST(Bindings, TheManualListsThem) {
    std::stringstream text;
    text << std::ifstream(sourceFolder() / "docs" / "viewer.md").rdbuf();
    const std::string manual = text.str();
    const Bindings gltf = Bindings::preset("gltf"), blender = Bindings::preset("blender");
    for (size_t i = 0; i < kActions; ++i) {
        const auto action = static_cast<Action>(i);
        const std::string row =
            fmt::format("| `{}` | {} | {} | {} |", infoOf(action).name, infoOf(action).does,
                        gltf.keysOf(action), blender.keysOf(action));
        EXPECT_NE(manual.find(row), std::string::npos) << row;
    }
}

}  // namespace
}  // namespace doppel::test
