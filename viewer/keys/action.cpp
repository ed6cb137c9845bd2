#include "viewer/keys/action.h"

#include <algorithm>
#include <array>

namespace doppel {

namespace {

constexpr const char *kCamera = "Camera", *kPose = "Pose", *kTime = "Time", *kShow = "Show",
                     *kFiles = "Files and window";

constexpr std::array<ActionInfo, kActions> kAll{{
    {"orbit", kCamera, "orbit", Trigger::Mouse},
    {"pan", kCamera, "pan", Trigger::Mouse},
    {"zoom", kCamera, "nearer, farther", Trigger::Mouse},
    {"frame-selected", kCamera, "see the selected joint"},
    {"frame-all", kCamera, "see all of the body"},
    {"front", kCamera, "from the front"},
    {"back", kCamera, "from behind"},
    {"left", kCamera, "from its left"},
    {"right", kCamera, "from its right"},
    {"top", kCamera, "from above"},
    {"bottom", kCamera, "from below"},
    {"opposite", kCamera, "from the other side"},
    {"orbit-left", kCamera, "15 degrees to the left"},
    {"orbit-right", kCamera, "15 degrees to the right"},
    {"orbit-up", kCamera, "15 degrees up"},
    {"orbit-down", kCamera, "15 degrees down"},
    {"zoom-in", kCamera, "a step nearer"},
    {"zoom-out", kCamera, "a step back"},
    {"orthographic", kCamera, "with perspective or without"},
    {"capture-camera", kCamera, "through the capture's camera"},
    {"walk", kCamera,
     "walk with W, A, S, D, E and Q, and look around with the mouse, until a click"},
    {"see-view", kCamera, "see the view that was kept under the digit", Trigger::Digit},
    {"keep-view", kCamera, "keep this view under the digit", Trigger::Digit},
    {"copy-camera", kCamera, "copy the camera as --camera has it"},
    {"paste-camera", kCamera, "paste the camera"},
    {"grab", kPose, "the joint goes with the mouse until a click"},
    {"rotate", kPose, "the joint turns with the mouse until a click; X, Y, Z and numbers say how"},
    {"pin", kPose, "pin the joint under the mouse, or let it go"},
    {"reset-joint", kPose, "reset the joint"},
    {"reset-pose", kPose, "reset the whole pose"},
    {"mirror", kPose, "mirror left and right"},
    {"copy-pose", kPose, "copy the pose as JSON"},
    {"paste-pose", kPose, "paste the pose"},
    {"paste-mirrored", kPose, "paste the pose, mirrored"},
    {"undo", kPose, "undo"},
    {"redo", kPose, "redo"},
    {"play", kTime, "play, or stop"},
    {"previous-frame", kTime, "a frame back"},
    {"next-frame", kTime, "a frame on"},
    {"first-frame", kTime, "to the first frame"},
    {"last-frame", kTime, "to the last frame"},
    {"previous-key", kTime, "back to the key before"},
    {"next-key", kTime, "on to the next key"},
    {"key", kTime, "a key here; edits over a motion are keys of themselves"},
    {"remove-key", kTime, "take this frame's key away"},
    {"blend", kTime, "edits add to the motion, or override it"},
    {"wireframe", kShow, "wireframe"},
    {"light", kShow, "the capture's light, none, a lamp"},
    {"joints", kShow, "joints"},
    {"floor", kShow, "floor"},
    {"compare", kShow, "compare: meshes, textures, source, avatars, off"},
    {"inspector", kShow, "the inspector: a click tells what is known of a point"},
    {"panel", kShow, "the panel"},
    {"open", kFiles, "open a file"},
    {"open-folder", kFiles, "open an avatar's or a capture's folder"},
    {"save", kFiles, "save what is seen, as a poses.npz"},
    {"save-as", kFiles, "save it under another name"},
    {"picture", kFiles, "save the picture"},
    {"film", kFiles, "film, as the panel's Files says"},
    {"larger", kFiles, "larger letters"},
    {"smaller", kFiles, "smaller letters"},
    {"plain-size", kFiles, "letters of scale 1"},
    {"help", kFiles, "the keys"},
    {"cancel", kFiles, "give up a drag or a film; deselect"},
    {"quit", kFiles, "quit"},
}};

}  // namespace

std::span<const ActionInfo, kActions> allActions() { return kAll; }

std::optional<Action> actionNamed(std::string_view name) {
    const auto found = std::ranges::find_if(
        kAll, [&](const ActionInfo& info) { return name == std::string_view(info.name); });
    if (found == kAll.end()) return std::nullopt;
    return static_cast<Action>(found - kAll.begin());
}

}  // namespace doppel
