// What keys, drags and the wheel can do in the window.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

namespace doppel {

enum class Action {
    Orbit,
    Pan,
    Zoom,
    FrameSelected,
    FrameAll,
    Front,
    Back,
    Left,
    Right,
    Top,
    Bottom,
    Opposite,
    OrbitLeft,
    OrbitRight,
    OrbitUp,
    OrbitDown,
    ZoomIn,
    ZoomOut,
    Orthographic,
    CaptureCamera,
    Walk,
    SeeView,
    KeepView,
    CopyCamera,
    PasteCamera,
    Grab,
    Rotate,
    Pin,
    ResetJoint,
    ResetPose,
    Mirror,
    CopyPose,
    PastePose,
    PasteMirrored,
    Undo,
    Redo,
    Play,
    PreviousFrame,
    NextFrame,
    FirstFrame,
    LastFrame,
    PreviousKey,
    NextKey,
    SetKey,
    RemoveKey,
    Blend,
    Wireframe,
    Light,
    Joints,
    Floor,
    Compare,
    Inspector,
    Panel,
    Open,
    OpenFolder,
    Save,
    SaveAs,
    Picture,
    Film,
    Larger,
    Smaller,
    PlainSize,
    Help,
    Cancel,
    Quit,
};
constexpr size_t kActions = static_cast<size_t>(Action::Quit) + 1;

// What brings it about: a key; a drag or the wheel; a key together with one of the digits 1 to 9.
enum class Trigger { Key, Mouse, Digit };

struct ActionInfo {
    const char* name;   // in files
    const char* group;  // under which the help lists it
    const char* does;
    Trigger trigger = Trigger::Key;
};

// In the order of the enumeration.
std::span<const ActionInfo, kActions> allActions();
inline const ActionInfo& infoOf(Action action) { return allActions()[static_cast<size_t>(action)]; }
std::optional<Action> actionNamed(std::string_view name);

}  // namespace doppel
