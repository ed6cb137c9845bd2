#include "viewer/pose/pose_editor.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/error.h"
#include "viewer/pose/pose_text.h"

namespace doppel {

namespace {

constexpr std::string_view kCameraStep = "camera";
// Keys in all steps together; a tenth of a gigabyte.
constexpr size_t kMostKeysKept = size_t{100} * 1024 * 1024 / sizeof(Keyframe);

void requireTime(double time) {
    if (!(std::abs(time) <= kLargestTime))
        throwInput("keyframe: expected a time from {} to {} frames, found {}", -kLargestTime,
                   kLargestTime, time);
}

// The first key at this time or later.
std::vector<Keyframe>::iterator keyAt(std::vector<Keyframe>& keys, double time) {
    return std::ranges::lower_bound(keys, time - kSameTime, {}, &Keyframe::time);
}

// The keys with this pose at this time, in place of one that is there.
std::vector<Keyframe> withKey(std::vector<Keyframe> keys, double time, const Pose& pose) {
    const auto at = keyAt(keys, time);
    if (at != keys.end() && at->time <= time + kSameTime)
        at->pose = pose;
    else
        keys.insert(at, {time, pose});
    return keys;
}

}  // namespace

PoseEditor::PoseEditor(const Pose& pose, const Betas& betas, size_t history)
    : history_(history), openedPose_(pose), openedBetas_(betas) {
    now_.pose = pose;
    now_.betas = betas;
    saved_ = now_;
}

Pose PoseEditor::original() const {
    return now_.motion ? motionPose(*now_.motion, time_) : openedPose_;
}

Take PoseEditor::take() const {
    return {now_.motion, *now_.keyframes, now_.layer, now_.pose, now_.betas};
}

// ---- steps --------------------------------------------------------------------------------------

void PoseEditor::push(std::string_view name, State before) {
    future_.clear();
    past_.push_back({std::string(name), std::move(before), time_});
    // Steps that leave the keys alone share them.
    size_t keys = 0;
    for (size_t i = 0; i < past_.size(); ++i)
        if (i == 0 || past_[i].other.keyframes != past_[i - 1].other.keyframes)
            keys += past_[i].other.keyframes->size();
    while (past_.size() > history_ || (keys > kMostKeysKept && past_.size() > 1)) {
        if (past_[0].other.keyframes != past_[1].other.keyframes)
            keys -= past_[0].other.keyframes->size();
        past_.pop_front();
    }
}

void PoseEditor::change(std::string_view name, State next) {
    if (next == now_) return;
    if (!inGesture_) push(name, now_);
    now_ = std::move(next);
    ++version_;
}

void PoseEditor::changeKeyframes(std::string_view name, std::vector<Keyframe> keyframes) {
    State next = now_;
    next.keyframes = std::make_shared<const std::vector<Keyframe>>(std::move(keyframes));
    if (next.timed())
        next.pose = doppel::poseAt(next.motion.get(), *next.keyframes, next.layer, time_);
    change(name, std::move(next));
}

void PoseEditor::showTime() {
    if (now_.timed()) now_.pose = poseAt(time_);
}

void PoseEditor::goTo(double time) {
    CHECK(std::isfinite(time), "a time is finite");
    if (time == time_) return;
    endGesture();
    time_ = time;
    showTime();
}

void PoseEditor::become(const State& state, double time) {
    const bool overTime = !state.sameOverTime(now_);
    now_ = state;
    ++version_;
    if (overTime) time_ = time;
    showTime();
}

void PoseEditor::beginGesture(std::string_view name) {
    endGesture();
    inGesture_ = true;
    gesture_ = name;
    began_ = now_;
}

void PoseEditor::endGesture() {
    if (!inGesture_) return;
    inGesture_ = false;
    if (now_ != began_) push(gesture_, began_);
}

void PoseEditor::cancelGesture() {
    if (!inGesture_) return;
    inGesture_ = false;
    now_ = began_;
    ++version_;
}

void PoseEditor::undo() {
    if (inGesture_) return cancelGesture();
    if (past_.empty()) return;
    const Step step = std::move(past_.back());
    past_.pop_back();
    future_.push_back({step.name, now_, step.time});
    become(step.other, step.time);
}

void PoseEditor::redo() {
    if (!canRedo()) return;
    const Step step = std::move(future_.back());
    future_.pop_back();
    past_.push_back({step.name, now_, step.time});
    become(step.other, step.time);
}

std::string_view PoseEditor::undoName() const {
    if (inGesture_) return canUndo() ? std::string_view(gesture_) : std::string_view();
    return past_.empty() ? std::string_view() : past_.back().name;
}

std::string_view PoseEditor::redoName() const {
    return canRedo() ? std::string_view(future_.back().name) : std::string_view();
}

bool PoseEditor::modified() const {
    const State& now = now_;
    const auto sameAs = [&](const State& other) {
        // Where poses have a time, the one that is shown is no part of the work.
        return now.betas == other.betas && now.sameOverTime(other) &&
               (now.timed() || now.pose == other.pose);
    };
    State beginning;
    beginning.pose = openedPose_;
    beginning.betas = openedBetas_;
    beginning.motion = now.motion;
    beginning.layer = now.layer;
    const bool keysSaved = saved_.opening == now.opening && !saved_.keyframes->empty();
    return !sameAs(saved_) && (keysSaved || !sameAs(beginning));
}

void PoseEditor::beginHere() {
    endGesture();
    past_.clear();
    future_.clear();
    markSaved();
}

void PoseEditor::setOpenedBetas(const Betas& betas) {
    const Betas before = std::exchange(openedBetas_, betas);
    const auto follow = [&](State& state) {
        if (state.betas == before) state.betas = betas;
    };
    for (State* state : {&now_, &began_, &saved_}) follow(*state);
    for (std::deque<Step>* steps : {&past_, &future_})
        for (Step& step : *steps) follow(step.other);
}

// ---- edits --------------------------------------------------------------------------------------

void PoseEditor::setPose(const Pose& pose, std::string_view what) {
    CHECK(isFinite(pose), "a pose's numbers are finite");
    if (pose == now_.pose) return;
    State next = now_;
    next.pose = pose;
    if (inGesture_ && pose == began_.pose)
        next.keyframes = began_.keyframes;  // there and back is no key
    else if (next.timed())
        next.keyframes =
            std::make_shared<const std::vector<Keyframe>>(withKey(*now_.keyframes, time_, pose));
    change(what, std::move(next));
}

void PoseEditor::setBetas(const Betas& betas, std::string_view what) {
    CHECK(std::all_of(betas.begin(), betas.end(), [](float b) { return std::isfinite(b); }),
          "a shape's numbers are finite");
    State next = now_;
    next.betas = betas;
    change(what, std::move(next));
}

void PoseEditor::openMotion(std::shared_ptr<const Motion> motion, std::string_view what) {
    endGesture();
    State next = now_;
    next.motion = std::move(motion);
    next.opening = ++openings_;
    next.keyframes = std::make_shared<const std::vector<Keyframe>>();
    if (next.motion) next.pose = motionPose(*next.motion, time_);
    change(what, std::move(next));
}

void PoseEditor::openTake(const Take& take, double time, std::string_view what) {
    endGesture();
    for (const Keyframe& key : take.keys) requireTime(key.time);
    requireTime(time);
    CHECK(isFinite(take.pose), "a pose's numbers are finite");
    State next = now_;
    next.pose = take.pose;
    next.betas = take.betas;
    next.motion = take.motion;
    next.opening = ++openings_;
    next.layer = take.layer;
    next.keyframes = std::make_shared<const std::vector<Keyframe>>(take.keys);
    if (next.timed())
        next.pose = doppel::poseAt(next.motion.get(), *next.keyframes, next.layer, time);
    change(what, std::move(next));
    time_ = time;
}

void PoseEditor::resetJoint(size_t joint, bool andTheOneAcross) {
    Pose pose = doppel::resetJoint(now_.pose, joint, original());
    if (andTheOneAcross) pose = doppel::resetJoint(pose, oppositeJoint(joint), original());
    setPose(pose, fmt::format("reset {}", jointName(joint)));
}

void PoseEditor::resetPose() { setPose(original(), "reset pose"); }
void PoseEditor::resetBetas() { setBetas(openedBetas_, "reset shape"); }
void PoseEditor::mirror() { setPose(mirrored(now_.pose), "mirror"); }
void PoseEditor::copySide(bool leftToRight) {
    setPose(sideCopied(now_.pose, leftToRight),
            leftToRight ? "copy left to right" : "copy right to left");
}

std::string PoseEditor::copy() const { return poseText(now_.pose, now_.betas); }

void PoseEditor::paste(std::string_view text, bool mirrored) {
    Pose pose = now_.pose;
    readPoseText(text, pose);
    setPose(mirrored ? doppel::mirrored(pose) : pose, "paste");
}

// ---- the camera ---------------------------------------------------------------------------------

void PoseEditor::moveCamera(std::string camera) {
    if (camera == now_.camera) return;
    endGesture();
    if (!now_.camera.empty()) push(kCameraStep, now_);
    now_.camera = std::move(camera);
}

void PoseEditor::forgetCamera() {
    endGesture();
    for (std::deque<Step>* steps : {&past_, &future_}) {
        std::erase_if(*steps, [](const Step& step) { return step.name == kCameraStep; });
        for (Step& step : *steps) step.other.camera.clear();
    }
    now_.camera.clear();
}

// ---- keys ---------------------------------------------------------------------------------------

void PoseEditor::setKeyframe(double time) {
    requireTime(time);
    changeKeyframes("set keyframe", withKey(*now_.keyframes, time, now_.pose));
}

bool PoseEditor::removeKeyframe(double time) {
    std::vector<Keyframe> keyframes = *now_.keyframes;
    const auto at = keyAt(keyframes, time);
    if (at == keyframes.end() || !(at->time <= time + kSameTime)) return false;
    keyframes.erase(at);
    changeKeyframes("remove keyframe", std::move(keyframes));
    return true;
}

void PoseEditor::changeLayer(std::string_view name, const Layer& layer) {
    State next = now_;
    next.layer = layer;
    if (next.timed())
        next.pose = doppel::poseAt(next.motion.get(), *next.keyframes, next.layer, time_);
    change(name, std::move(next));
}

void PoseEditor::setFade(double frames) {
    if (!std::isfinite(frames)) return;
    changeLayer("fade", {std::clamp(frames, 0., kLongestFade), now_.layer.blend});
}

void PoseEditor::setBlend(Layer::Blend blend) {
    changeLayer(blend == Layer::Blend::Add ? "add to the motion" : "override the motion",
                {now_.layer.fade, blend});
}

Pose PoseEditor::poseAt(double time) const {
    if (!now_.timed() || std::isnan(time)) return now_.pose;
    return doppel::poseAt(now_.motion.get(), *now_.keyframes, now_.layer, time);
}

}  // namespace doppel
