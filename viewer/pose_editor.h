// A pose being edited: undo and redo, reset, mirror, text for the clipboard, keyframes.
#pragma once

#include <cstddef>
#include <deque>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "viewer/skeleton.h"

namespace doppel {

struct Keyframe {
    double time = 0;  // frames of the timeline; need not be whole
    Pose pose;
    bool operator==(const Keyframe&) const = default;
};

// Every change is a step that undo() takes back: pose, shape and keyframes together. Changes
// between beginGesture() and endGesture() are one step, and none where they left everything as it
// was.
//
//     editor.beginGesture("move left_wrist");
//     for (each mouse move) editor.setPose(solveIk(skeleton, editor.pose(), target,
//                                                  {.began = &editor.gestureBegan()}));
//     editor.endGesture();
class PoseEditor {
public:
    // The pose and shape that resets go back to. `history`: the most steps that are kept; older
    // ones are forgotten.
    explicit PoseEditor(const Pose& pose = {}, const Betas& betas = {}, size_t history = 500);

    const Pose& pose() const { return now_.pose; }
    const Betas& betas() const { return now_.betas; }
    const Pose& opened() const { return openedPose_; }

    void setPose(const Pose& pose, std::string_view what = "pose");
    void setBetas(const Betas& betas, std::string_view what = "shape");
    // What a timeline or a newly opened motion shows: no step, and what resets go back to from now
    // on. Ends a gesture.
    void show(const Pose& pose);

    // ---- steps ----
    // A gesture that is begun within another one ends that one first.
    void beginGesture(std::string_view name);
    void endGesture();
    void cancelGesture();  // everything as it was when it began
    bool inGesture() const { return inGesture_; }
    // The pose in which the gesture began; outside of gestures, the current one.
    const Pose& gestureBegan() const { return inGesture_ ? began_.pose : now_.pose; }

    bool canUndo() const { return inGesture_ ? began_ != now_ : !past_.empty(); }
    bool canRedo() const { return !inGesture_ && !future_.empty(); }
    void undo();  // within a gesture: cancels it. Nothing where there is nothing to undo
    void redo();
    // What undo() would take back and redo() do again; empty: nothing.
    std::string_view undoName() const;
    std::string_view redoName() const;
    size_t steps() const { return past_.size(); }

    // ---- edits ----
    void resetJoint(size_t joint);
    void resetPose();
    void resetBetas();
    void mirror();

    // {"doppel_pose": 1, "joints": {"left_wrist": [x, y, z], …}, "trans": [x, y, z],
    //  "betas": [10 numbers]}
    // Rotations are axis-angle in radians. paste() takes what is there and leaves the rest: joints
    // that are not named, trans, betas. InputError, nothing being changed, where the text is longer
    // than 64 KiB, is not JSON, names what does not exist, or holds something else than finite
    // numbers of sensible size.
    std::string copy() const;
    void paste(std::string_view text);

    // ---- keyframes, in the order of time ----
    std::span<const Keyframe> keyframes() const { return *now_.keyframes; }
    // The pose as it is at this time: a new keyframe, or in place of the one that is there.
    // InputError where the time is not a number that a timeline has.
    void setKeyframe(double time);
    bool removeKeyframe(double time);  // whether there was one
    void clearKeyframes();
    // Between keyframes rotations go the short way at an even pace and places straight; before the
    // first and after the last, those. Without keyframes the pose as it is.
    Pose poseAt(double time) const;

    // A poses.npz of the keyframes alone, one frame each, `key_times` [K] beside them; fps is the
    // timeline's. Whole or not at all. InputError where there are none.
    void saveKeyframes(const std::filesystem::path& out, double timelineFps) const;
    // One of all poses from the first keyframe to the last, fps frames for each second.
    void saveSampled(const std::filesystem::path& out, double timelineFps, double fps) const;
    // A step that replaces the keyframes by those of a file: at its key_times, else one a frame.
    // Everything that readMotion refuses is refused, and times that do not grow.
    void loadKeyframes(const std::filesystem::path& file);

private:
    using Keyframes = std::shared_ptr<const std::vector<Keyframe>>;
    struct State {
        Pose pose;
        Betas betas{};
        Keyframes keyframes = std::make_shared<const std::vector<Keyframe>>();
        bool operator==(const State& other) const {
            return pose == other.pose && betas == other.betas &&
                   (keyframes == other.keyframes || *keyframes == *other.keyframes);
        }
    };
    struct Step {
        std::string name;
        State other;  // before it in past_, after it in future_
    };
    void change(std::string_view name, State next);
    void changeKeyframes(std::string_view name, std::vector<Keyframe> keyframes);
    void push(std::string_view name, State before);

    size_t history_;
    Pose openedPose_;
    Betas openedBetas_;
    State now_, began_;
    bool inGesture_ = false;
    std::string gesture_;
    std::deque<Step> past_, future_;  // the latest at the back
};

}  // namespace doppel
