#include "viewer/keys/bindings.h"

#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <sstream>

#include "engine/error.h"
#include "engine/files/atomic_file.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr std::string_view kGltf = "gltf", kBlender = "blender";
constexpr uint64_t kLargestFile = uint64_t{1} << 20;
constexpr size_t kMostChords = 16;  // of an action

// What both have. Chords of an action are separated by two spaces.
constexpr std::array<std::pair<Action, const char*>, 33> kCommon{{
    {Action::FrameAll, "Home"},
    {Action::Orthographic, "5  Numpad 5"},
    {Action::CaptureCamera, "0  Numpad 0"},
    {Action::Opposite, "9  Numpad 9"},
    {Action::SeeView, "Ctrl + digit"},
    {Action::KeepView, "Ctrl + Shift + digit"},
    {Action::CopyPose, "Ctrl + C"},
    {Action::PastePose, "Ctrl + V"},
    {Action::Undo, "Ctrl + Z"},
    {Action::Redo, "Ctrl + Shift + Z  Ctrl + Y"},
    {Action::Pin, "P"},
    {Action::Play, "Space"},
    {Action::PreviousFrame, "left"},
    {Action::NextFrame, "right"},
    {Action::FirstFrame, "Shift + left"},
    {Action::LastFrame, "Shift + right"},
    {Action::PreviousKey, "down"},
    {Action::NextKey, "up"},
    {Action::Blend, "Alt + K"},
    {Action::Light, "L"},
    {Action::Compare, "B"},
    {Action::Open, "Ctrl + O"},
    {Action::OpenFolder, "Ctrl + Shift + O"},
    {Action::Save, "Ctrl + S"},
    {Action::SaveAs, "Ctrl + Shift + S"},
    {Action::Picture, "F12"},
    {Action::Film, "Ctrl + F12"},
    {Action::Larger, "Ctrl + plus  Ctrl + Numpad +  Ctrl + ="},
    {Action::Smaller, "Ctrl + minus  Ctrl + Numpad -"},
    {Action::PlainSize, "Ctrl + 0  Ctrl + Numpad 0"},
    {Action::Help, "H  F1"},
    {Action::Cancel, "Escape"},
    {Action::Quit, "Ctrl + Q"},
}};

// After three.js's OrbitControls and model-viewer; the middle button orbits as well. With Alt the
// camera goes, too, where a joint is under the mouse.
constexpr std::array<std::pair<Action, const char*>, 28> kOfGltf{{
    {Action::Orbit, "left drag  middle drag  Alt + left drag"},
    {Action::Pan,
     "right drag  Shift + left drag  Ctrl + left drag  Shift + right drag  Shift + middle drag  "
     "Alt + Shift + left drag  Shift + wheel  wheel sideways"},
    {Action::Zoom, "wheel  Ctrl + wheel  Ctrl + middle drag  Alt + Ctrl + left drag"},
    {Action::FrameSelected, "F  Numpad ."},
    {Action::Front, "1  Numpad 1"},
    {Action::Back, "Shift + 1  Shift + Numpad 1"},
    {Action::Left, "3  Numpad 3"},
    {Action::Right, "Shift + 3  Shift + Numpad 3"},
    {Action::Top, "7  Numpad 7"},
    {Action::Bottom, "Shift + 7  Shift + Numpad 7"},
    {Action::ZoomIn, "plus  Numpad +  ="},
    {Action::ZoomOut, "minus  Numpad -"},
    {Action::Walk, "Shift + W"},
    {Action::CopyCamera, "Ctrl + Shift + C"},
    {Action::PasteCamera, "Ctrl + Shift + V"},
    {Action::PasteMirrored, "Ctrl + Alt + V"},
    {Action::ResetJoint, "R"},
    {Action::ResetPose, "Shift + R"},
    {Action::Mirror, "M"},
    {Action::SetKey, "K"},
    {Action::RemoveKey, "Shift + K"},
    {Action::Wireframe, "W"},
    {Action::Joints, "J"},
    {Action::Floor, "G"},
    {Action::Inspector, "I"},
    {Action::Panel, "N  Tab"},
    {Action::Grab, "T"},
    {Action::Rotate, "Shift + T"},
}};

// After Blender 4's own keymap with its "Emulate 3 Button Mouse" and "Emulate Numpad". The left
// button, which has no box to select with here, orbits as well.
constexpr std::array<std::pair<Action, const char*>, 33> kOfBlender{{
    {Action::Orbit, "middle drag  Alt + left drag  left drag"},
    {Action::Pan,
     "Shift + middle drag  Alt + Shift + left drag  Shift + left drag  Shift + wheel  "
     "wheel sideways"},
    {Action::Zoom, "wheel  Ctrl + middle drag  Alt + Ctrl + left drag  Ctrl + wheel"},
    {Action::FrameSelected, "Numpad .  ."},
    {Action::Front, "Numpad 1  1"},
    {Action::Back, "Ctrl + Numpad 1"},
    {Action::Left, "Numpad 3  3"},
    {Action::Right, "Ctrl + Numpad 3"},
    {Action::Top, "Numpad 7  7"},
    {Action::Bottom, "Ctrl + Numpad 7"},
    {Action::OrbitLeft, "Numpad 4  4"},
    {Action::OrbitRight, "Numpad 6  6"},
    {Action::OrbitUp, "Numpad 8  8"},
    {Action::OrbitDown, "Numpad 2  2"},
    {Action::ZoomIn, "Numpad +  plus  ="},
    {Action::ZoomOut, "Numpad -  minus"},
    {Action::Walk, "Shift + `"},
    {Action::CopyCamera, "Ctrl + Alt + C"},
    {Action::PasteCamera, "Ctrl + Alt + V"},
    {Action::PasteMirrored, "Ctrl + Shift + V"},
    {Action::Grab, "G"},
    {Action::Rotate, "R"},
    {Action::ResetJoint, "Alt + R  Alt + G"},
    {Action::ResetPose, "Shift + Alt + R"},
    {Action::Mirror, "Ctrl + M"},
    {Action::SetKey, "I  K"},
    {Action::RemoveKey, "Alt + I"},
    {Action::Wireframe, "Shift + Z"},
    {Action::Joints, "Shift + Alt + Z  J"},
    {Action::Floor, "Shift + G"},
    {Action::Inspector, "Shift + I"},
    {Action::Panel, "N"},
    {Action::Redo, "Ctrl + Shift + Z"},
}};

std::vector<Chord> chordsIn(std::string_view text) {
    std::vector<Chord> chords;
    while (!text.empty()) {
        const size_t end = std::min(text.find("  "), text.size());
        const auto chord = readChord(text.substr(0, end));
        CHECK(chord, "\"{}\" is a chord", text.substr(0, end));
        chords.push_back(*chord);
        text.remove_prefix(std::min(end + 2, text.size()));
    }
    return chords;
}

const char* expectedFor(Trigger trigger) {
    switch (trigger) {
        case Trigger::Mouse:
            return "a drag or the wheel, such as \"Alt + left drag\" or \"Shift + wheel\"";
        case Trigger::Digit:
            return "what is held with a digit, such as \"Ctrl + digit\"";
        case Trigger::Key:
            break;
    }
    return "a key, such as \"Space\", \"Ctrl + Shift + Z\" or \"Numpad .\"";
}

// Steps of one letter from one word to the other (Levenshtein's distance).
size_t stepsBetween(std::string_view a, std::string_view b) {
    std::vector<size_t> row(b.size() + 1);
    for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (size_t i = 1; i <= a.size(); ++i) {
        size_t diagonal = std::exchange(row[0], i);
        for (size_t j = 1; j <= b.size(); ++j) {
            const size_t changed = diagonal + (a[i - 1] != b[j - 1]);
            diagonal = row[j];
            row[j] = std::min({row[j] + 1, row[j - 1] + 1, changed});
        }
    }
    return row.back();
}

const char* nearestAction(std::string_view word) {
    const auto found = std::ranges::min_element(
        allActions(), {}, [&](const ActionInfo& info) { return stepsBetween(word, info.name); });
    return found->name;
}

// One file while it is read.
class Reader {
public:
    explicit Reader(const fs::path& file) : file_(file.string()) {}

    [[noreturn]] void fail(const toml::source_region& at, const std::string& what) const {
        throwInput("{}: line {}: {}", file_, at.begin.line, what);
    }

    std::vector<Chord> chords(const toml::key& key, const toml::node& node, Trigger trigger) {
        std::vector<Chord> chords;
        const auto add = [&](const toml::node& one) {
            const auto text = one.value_exact<std::string>();
            const auto chord = text ? readChord(*text) : std::nullopt;
            const Trigger is = !chord                  ? trigger
                               : chord->isMouse()      ? Trigger::Mouse
                               : chord->code == kDigit ? Trigger::Digit
                                                       : Trigger::Key;
            if (!chord || is != trigger) {
                std::ostringstream found;
                if (text)
                    found << '"' << text->substr(0, 60) << '"';
                else
                    found << "no text";
                fail(one.source(), fmt::format("{}: expected {}, found {}", key.str(),
                                               expectedFor(trigger), found.str()));
            }
            const auto [other, isNew] = lines_.try_emplace(
                *chord, std::pair(std::string(key.str()), one.source().begin.line));
            if (!isNew)
                fail(one.source(),
                     fmt::format("{}: expected a chord that nothing else has, found \"{}\", which "
                                 "line {} gives to {}",
                                 key.str(), textOf(*chord), other->second.second,
                                 other->second.first));
            chords.push_back(*chord);
        };
        const toml::array* list = node.as_array();
        if (!list) {
            add(node);
            return chords;
        }
        if (list->size() > kMostChords)
            fail(node.source(), fmt::format("{}: expected at most {} chords, found {}", key.str(),
                                            kMostChords, list->size()));
        for (const toml::node& one : *list) add(one);
        return chords;
    }

    bool taken(const Chord& chord) const { return lines_.contains(chord); }

private:
    std::string file_;
    std::map<Chord, std::pair<std::string, toml::source_index>> lines_;
};

}  // namespace

bool Bindings::isPreset(std::string_view name) { return name == kGltf || name == kBlender; }

Bindings Bindings::preset(std::string_view name, const std::string& what) {
    if (!isPreset(name))
        throwInput("{}: expected \"{}\" or \"{}\", found \"{}\"", what, kGltf, kBlender,
                   name.substr(0, 60));
    Bindings bindings;
    bindings.name_ = name;
    for (const auto& [action, chords] : kCommon) bindings.set(action, chordsIn(chords));
    if (name == kGltf)
        for (const auto& [action, chords] : kOfGltf) bindings.set(action, chordsIn(chords));
    else
        for (const auto& [action, chords] : kOfBlender) bindings.set(action, chordsIn(chords));
    return bindings;
}

Bindings Bindings::named(const std::string& nameOrFile) {
    if (isPreset(nameOrFile)) return preset(nameOrFile);
    std::error_code error;
    if (!fs::exists(nameOrFile, error))
        throwInput("keys: expected \"{}\", \"{}\" or a file that is there, found \"{}\"", kGltf,
                   kBlender, nameOrFile);
    return read(nameOrFile);
}

Bindings Bindings::read(const fs::path& file) {
    const std::vector<uint8_t> bytes = readWholeFile(file, kLargestFile);
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    Reader reader(file);
    toml::table table;
    try {
        table = toml::parse(text, file.string());
    } catch (const toml::parse_error& error) {
        reader.fail(error.source(), fmt::format("not TOML: {}", error.description()));
    }
    std::string base(kGltf);
    if (const toml::node* node = table.get("preset")) {
        base = node->value_exact<std::string>().value_or("");
        if (!isPreset(base))
            reader.fail(node->source(),
                        fmt::format("preset: expected \"{}\" or \"{}\"{}", kGltf, kBlender,
                                    base.empty() ? "" : ", found \"" + base.substr(0, 60) + "\""));
    }
    Bindings bindings = preset(base);
    bindings.name_ = file.string();
    std::array<bool, kActions> named{};
    for (const auto& [key, node] : table) {
        if (key.str() == "preset") continue;
        const auto action = actionNamed(key.str());
        if (!action)
            reader.fail(
                key.source(),
                fmt::format("expected preset or an action, such as {}, found \"{}\"",
                            nearestAction(key.str().substr(0, 60)), key.str().substr(0, 60)));
        bindings.set(*action, reader.chords(key, node, infoOf(*action).trigger));
        named[static_cast<size_t>(*action)] = true;
    }
    for (size_t i = 0; i < kActions; ++i)
        if (!named[i])
            std::erase_if(bindings.chords_[i], [&](const Chord& c) { return reader.taken(c); });
    return bindings;
}

std::string Bindings::text() const {
    std::string text =
        "# Keys of `doppel view`. A line that is not here is as in the preset, \"gltf\" or\n"
        "# \"blender\"; [] takes away all that an action has.\n"
        "preset = \"gltf\"\n";
    const char* group = "";
    for (size_t i = 0; i < kActions; ++i) {
        const ActionInfo& info = allActions()[i];
        if (std::string_view(group) != info.group)
            text += fmt::format("\n# {}\n", group = info.group);
        std::vector<std::string> chords;
        for (const Chord& chord : chords_[i]) chords.push_back('"' + textOf(chord) + '"');
        text += fmt::format("{} = [{}]  # {}\n", info.name, fmt::join(chords, ", "), info.does);
    }
    return text;
}

std::optional<Action> Bindings::actionOf(const Chord& chord) const {
    const auto find = [this](const Chord& wanted) -> std::optional<Action> {
        for (size_t i = 0; i < kActions; ++i)
            if (std::ranges::count(chords_[i], wanted) > 0) return static_cast<Action>(i);
        return std::nullopt;
    };
    auto action = find(chord);
    if (!action && chord.code >= '1' && chord.code <= '9') action = find({kDigit, chord.modifiers});
    return action;
}

std::string Bindings::keysOf(Action action) const {
    std::string text;
    for (const Chord& chord : of(action)) text += (text.empty() ? "" : ", ") + textOf(chord);
    return text;
}

std::string Bindings::keyOf(Action action) const {
    return of(action).empty() ? std::string() : textOf(of(action).front());
}

std::string Bindings::tip(std::string_view does, Action action) const {
    const std::string key = keyOf(action);
    return key.empty() ? fmt::format("{}.", does) : fmt::format("{} ({}).", does, key);
}

void Bindings::useTouchpad() {
    for (std::vector<Chord>& chords : chords_)
        std::erase_if(chords,
                      [](const Chord& c) { return c.code == kWheel || c.code == kSidewaysWheel; });
    for (const auto& [action, text] : {std::pair{Action::Orbit, "wheel"},
                                       {Action::Pan, "Shift + wheel"},
                                       {Action::Zoom, "Ctrl + wheel"}}) {
        std::vector<Chord>& chords = chords_[static_cast<size_t>(action)];
        chords.insert(chords.begin(), *readChord(text));
    }
}

}  // namespace doppel
