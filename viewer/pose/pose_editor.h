// A pose being edited, alone or at a time of a motion: undo and redo, reset, mirror, keys.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "viewer/pose/take.h"

namespace doppel {

// Every change is a step that undo() takes back: pose, shape, keys and motion together. Changes
// between beginGesture() and endGesture() are one step, and none where they left everything as it
// was.
//
//     const Pose began = editor.pose();
//     editor.beginGesture("move left_wrist");
//     for (each mouse move) editor.setPose(solveIk(skeleton, began, targets));
//     editor.endGesture();
//
// Where there is a motion or a key, poses belong to a time: what is edited becomes a key of the
// time that is shown, and is still there when the time comes again.
class PoseEditor {
public:
    // The pose and shape that resets go back to. `history`: the most steps that are kept; older
    // ones are forgotten, and sooner where they hold more keys than memory should.
    explicit PoseEditor(const Pose& pose = {}, const Betas& betas = {}, size_t history = 500);

    // As it is seen at time().
    const Pose& pose() const { return now_.pose; }
    const Betas& betas() const { return now_.betas; }
    // What resets go back to: the motion's pose, else the one that the editor began with.
    Pose original() const;
    const std::shared_ptr<const Motion>& motion() const { return now_.motion; }
    std::span<const Keyframe> keyframes() const { return *now_.keyframes; }
    const Layer& layer() const { return now_.layer; }
    bool timed() const { return now_.timed(); }
    // All of it, as writeTake() takes it.
    Take take() const;

    // The time that is shown, frames. goTo: no step; ends a gesture.
    double time() const { return time_; }
    void goTo(double time);

    void setPose(const Pose& pose, std::string_view what = "pose");
    void setBetas(const Betas& betas, std::string_view what = "shape");
    // Another motion, or none: the keys, which belong to the one before, go with it. One step.
    void openMotion(std::shared_ptr<const Motion> motion, std::string_view what = "open motion");
    // A take in the place of what there is, as one step; shown at `time`. InputError where keys
    // lie beyond what a timeline has.
    void openTake(const Take& take, double time, std::string_view what);

    // ---- what is not saved yet ----
    // Whether something was edited that is not as markSaved() or the beginning saw it. Once keys of
    // what is open were saved, the beginning is an edit as well: the file has them still.
    bool modified() const;
    void markSaved() { saved_ = now_; }
    // What there is now was there when the work began: it is saved, and undo ends with it.
    void beginHere();
    // Counts changes, undo and redo among them.
    uint64_t version() const { return version_; }
    // Which of the motions and takes that were opened this is, counted from 1; 0: the beginning.
    // Undo goes back to an earlier one's number.
    uint64_t opening() const { return now_.opening; }
    // The person's own shape is another one now. Where the shape was the old one it becomes this,
    // without a step, in all steps.
    void setOpenedBetas(const Betas& betas);

    // ---- steps ----
    // A gesture that is begun within another one ends that one first.
    void beginGesture(std::string_view name);
    void endGesture();
    void cancelGesture();  // everything as it was when it began
    bool inGesture() const { return inGesture_; }

    bool canUndo() const { return inGesture_ ? began_ != now_ : !past_.empty(); }
    bool canRedo() const { return !inGesture_ && !future_.empty(); }
    // Within a gesture: cancels it. Nothing where there is nothing to undo. Where keys or the
    // motion change, time() goes to where the step was made.
    void undo();
    void redo();
    // What undo() would take back and redo() do again; empty: nothing.
    std::string_view undoName() const;
    std::string_view redoName() const;
    size_t steps() const { return past_.size(); }

    // ---- edits ----
    void resetJoint(size_t joint, bool andTheOneAcross = false);
    void resetPose();
    void resetBetas();
    void mirror();
    void copySide(bool leftToRight);

    // Text for the clipboard (pose_text.h). Pasting takes joints and place; the shape, which the
    // text has as well, is that of whom it was copied from.
    std::string copy() const;
    void paste(std::string_view text, bool mirrored = false);

    // ---- the camera ----
    // Where undo and redo bring back the camera as well: as text that only the caller reads; empty:
    // it is not followed.
    const std::string& camera() const { return now_.camera; }
    // A step, unless it is the first camera that is told; ends a gesture.
    void moveCamera(std::string camera);
    // No longer follows it: its steps are forgotten.
    void forgetCamera();

    // ---- keys, in the order of time ----
    // The pose as it is shown at this time: a new key, or in place of the one that is there.
    // InputError where the time is not a number that a timeline has.
    void setKeyframe(double time);
    bool removeKeyframe(double time);  // whether there was one
    // How long a key's change over a motion takes to come and go, frames; clamped to what Take
    // allows.
    void setFade(double frames);
    void setBlend(Layer::Blend blend);
    // Without motion and keys the pose as it is.
    Pose poseAt(double time) const;

private:
    using Keyframes = std::shared_ptr<const std::vector<Keyframe>>;
    struct State {
        Pose pose;
        Betas betas{};
        Keyframes keyframes = std::make_shared<const std::vector<Keyframe>>();
        std::shared_ptr<const Motion> motion;
        Layer layer;
        std::string camera;
        uint64_t opening = 0;

        bool timed() const { return motion || !keyframes->empty(); }
        bool sameOverTime(const State& other) const {
            return motion == other.motion && layer == other.layer &&
                   (keyframes == other.keyframes || *keyframes == *other.keyframes);
        }
        bool operator==(const State& other) const {
            return pose == other.pose && betas == other.betas && sameOverTime(other) &&
                   opening == other.opening && camera == other.camera;
        }
    };
    struct Step {
        std::string name;
        State other;      // before it in past_, after it in future_
        double time = 0;  // that was shown when it was made
    };
    void change(std::string_view name, State next);
    void changeLayer(std::string_view name, const Layer& layer);
    void changeKeyframes(std::string_view name, std::vector<Keyframe> keyframes);
    void push(std::string_view name, State before);
    void become(const State& state, double time);
    void showTime();

    size_t history_;
    Pose openedPose_;
    Betas openedBetas_;
    State now_, began_, saved_;
    double time_ = 0;
    uint64_t version_ = 1, openings_ = 0;
    bool inGesture_ = false;
    std::string gesture_;
    std::deque<Step> past_, future_;  // the latest at the back
};

}  // namespace doppel
