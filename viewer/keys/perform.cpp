// What keys do.
#include <GLFW/glfw3.h>
#include <imgui.h>
#include <imgui_internal.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr double kQuarter = std::numbers::pi / 2, kAbove = 1.55;
constexpr double kStep = std::numbers::pi / 12, kZoomStep = .9;

// A combo's list or a colour's picker; Dear ImGui closes them itself only where keys walk through
// its items. Whether there was one.
bool closeList() {
    if (!ImGui::IsPopupOpen("", ImGuiPopupFlags_AnyPopup)) return false;
    ImGui::ClosePopupsExceptModals();
    return true;
}

}  // namespace

void Viewer::handleKeys() {
    const ImGuiIO& io = ImGui::GetIO();
    for (const KeyPress& press : window_.keys()) {
        framesToDraw_ = 3;
        if (question_) {
            if (const auto label = question_.answerOf(press)) answer(*label);
            continue;
        }
        if (press.key == GLFW_KEY_ESCAPE && closeList()) continue;
        if (io.WantTextInput) continue;
        const Chord chord = chordOf(press.key, press.modifiers);
        if (typesIntoDrag(chord) || typesIntoWalk(chord)) continue;
        const std::optional<Action> action = keys_.actionOf(chord);
        if (!action) continue;
        attempt([&] { perform(*action, chord.code - '0'); });
        lastTouched_ = Clock::now();
    }
}

// digit: of the actions that have one.
void Viewer::perform(Action action, int digit) {
    const std::optional<size_t> at = hovered_ ? hovered_ : selected_;
    switch (action) {
        case Action::Orbit:
        case Action::Pan:
        case Action::Zoom:
            break;  // the mouse's
        case Action::FrameSelected:
            return frameSelected();
        case Action::FrameAll:
            return frameAll();
        case Action::Front:
            return lookFrom(0, 0);
        case Action::Back:
            return lookFrom(2 * kQuarter, 0);
        case Action::Left:
            return lookFrom(kQuarter, 0);
        case Action::Right:
            return lookFrom(-kQuarter, 0);
        case Action::Top:
            return lookFrom(orbit_.yaw, kAbove);
        case Action::Bottom:
            return lookFrom(orbit_.yaw, -kAbove);
        case Action::Opposite:
            return lookFrom(orbit_.yaw + 2 * kQuarter, -orbit_.pitch);
        case Action::OrbitLeft:
            return lookFrom(orbit_.yaw - kStep, orbit_.pitch);
        case Action::OrbitRight:
            return lookFrom(orbit_.yaw + kStep, orbit_.pitch);
        case Action::OrbitUp:
            return lookFrom(orbit_.yaw, orbit_.pitch + kStep);
        case Action::OrbitDown:
            return lookFrom(orbit_.yaw, orbit_.pitch - kStep);
        case Action::ZoomIn:
        case Action::ZoomOut:
            if (settings_.captureCamera && !panes_.empty()) {
                dragPane_ = panes_.front();
                leaveCaptureCamera();
            }
            return orbit_.dolly(action == Action::ZoomIn ? kZoomStep : 1 / kZoomStep);
        case Action::Orthographic:
            orbit_.orthographic = !orbit_.orthographic;
            break;
        case Action::CaptureCamera:
            if (!motion() || motion()->cameras.empty()) break;
            settings_.captureCamera = !settings_.captureCamera;
            if (settings_.captureCamera) showFrames();
            break;
        case Action::Walk:
            return beginWalk();
        case Action::SeeView:
            return seeBookmark(digit);
        case Action::KeepView:
            return keepView(digit);
        case Action::CopyCamera:
            return copyCamera();
        case Action::PasteCamera:
            return pasteCamera();
        case Action::Grab:
        case Action::Rotate:
            return beginModalDrag(action == Action::Grab ? Drag::Joint : Drag::Ring);
        case Action::Pin:
            if (at && *at != joint::kPelvis && !pins_.erase(*at)) pins_.insert(*at);
            break;
        case Action::ResetJoint:
            if (at) editor_->resetJoint(*at, editsBothSides(*at));
            break;
        case Action::ResetPose:
            return editor_->resetPose();
        case Action::Mirror:
            return editor_->mirror();
        case Action::CopyPose:
            window_.setClipboard(editor_->copy());
            return say("pose copied");
        case Action::PastePose:
            return editor_->paste(window_.clipboard());
        case Action::PasteMirrored:
            editor_->paste(window_.clipboard(), true);
            break;
        case Action::Undo:
            return undo();
        case Action::Redo:
            return redo();
        case Action::Play:
            return play(!playing_);
        case Action::PreviousFrame:
        case Action::NextFrame:
            return step(action == Action::PreviousFrame ? -1 : 1);
        case Action::FirstFrame:
            return step(-static_cast<int>(timelineEnd()));
        case Action::LastFrame:
            return step(static_cast<int>(frameCount() - 1 - static_cast<int64_t>(timeline_)));
        case Action::PreviousKey:
        case Action::NextKey:
            return stepToKey(action == Action::NextKey);
        case Action::SetKey:
            return setKey();
        case Action::RemoveKey:
            editor_->removeKeyframe(std::floor(timeline_));
            break;
        case Action::Blend:
            return changeBlend();
        case Action::Wireframe:
            settings_.wireframe = !settings_.wireframe;
            break;
        case Action::Light:
            return nextLight();
        case Action::Joints:
            settings_.joints = !settings_.joints;
            break;
        case Action::Floor:
            settings_.floor = !settings_.floor;
            break;
        case Action::Compare:
            return nextSplit();
        case Action::Inspector:
            return toggleInspector();
        case Action::Panel:
            settings_.panel = !settings_.panel;
            break;
        case Action::Open:
        case Action::OpenFolder:
            return chooseFile(action == Action::Open ? FileDialog::Asks::File
                                                     : FileDialog::Asks::Folder);
        case Action::Save:
            return save();
        case Action::SaveAs:
            return chooseNewFile();
        case Action::Picture:
            return savePicture();
        case Action::Film:
            return startFilmAsSet();
        case Action::Larger:
            return setLook(settings_.theme, 1.1 * uiScale_);
        case Action::Smaller:
            return setLook(settings_.theme, uiScale_ / 1.1);
        case Action::PlainSize:
            return setLook(settings_.theme, 1);
        case Action::Help:
            settings_.help = !settings_.help;
            break;
        case Action::Cancel:
            return cancel();
        case Action::Quit:
            return window_.close();
    }
}

void Viewer::cancel() {
    if (walk_) {
        endWalk(false);
    } else if (drag_ == Drag::Joint || drag_ == Drag::Ring) {
        editor_->cancelGesture();
        endDrag();
    } else if (selected_ || inspected_ || settings_.help) {
        selected_.reset();
        inspected_.reset();
        settings_.help = false;
    } else if (film_) {
        askToGiveFilmUp();
    }
}

// Without a step that changes nothing: where nobody has learned a light, the capture's is as flat.
void Viewer::nextLight() {
    bool learned = !avatar_->avatar.light.empty();
    for (size_t i = 0; i < others_.size(); ++i) learned |= !others_[i].avatar().light.empty();
    if (settings_.light == kLightLamp)
        settings_.light = kLightCapture;
    else
        settings_.light = settings_.light == kLightCapture && learned ? kLightFlat : kLightLamp;
}

// To the nearest key on that side of the timeline's frame.
void Viewer::stepToKey(bool on) {
    const double now = std::floor(timeline_);
    const auto keys = editor_->keyframes();
    std::optional<double> to;
    for (const Keyframe& key : keys)
        if (on ? key.time > now && !to : key.time < now) to = key.time;
    if (!to) throwInput("there is no key {} this frame", on ? "after" : "before");
    step(static_cast<int>(*to - now));
}

void Viewer::frameAll() {
    if (panes_.empty()) return;
    Pose pose = editor_->pose();
    scene_->setPose(thetaOf(pose), transOf(pose), editor_->betas());
    settings_.captureCamera = false;
    orbit_.frame(scene_->vertices(settings_.mesh), panes_[0].viewWidth, panes_[0].height);
}

// A hand's breadth around the joint and what hangs on it next; all of the body without one.
void Viewer::frameSelected() {
    if (!selected_ || panes_.empty()) return frameAll();
    constexpr double kAround = .15;  // metres
    const PosedSkeleton body = posed();
    std::vector<float> points;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const bool next = j == *selected_ || skeleton().parents[j] == static_cast<int>(*selected_);
        for (double side : {-kAround, kAround})
            for (int axis = 0; next && axis < 3; ++axis) {
                glm::dvec3 point = body.position[j];
                point[axis] += side;
                for (int k = 0; k < 3; ++k) points.push_back(static_cast<float>(point[k]));
            }
    }
    settings_.captureCamera = false;
    orbit_.frame(points, panes_[0].viewWidth, panes_[0].height);
}

void Viewer::setKey() {
    const double now = std::floor(timeline_);
    editor_->setKeyframe(now);
    say(fmt::format("key at frame {:.0f}", now));
}

void Viewer::changeBlend() {
    if (!motion()) return say("edits add to a motion or override it; there is none");
    const bool adds = editor_->layer().blend == Layer::Blend::Add;
    editor_->setBlend(adds ? Layer::Blend::Override : Layer::Blend::Add);
    say(adds ? "edits override the motion" : "edits add to the motion");
}

void Viewer::copyCamera() {
    requireOwnCamera();
    window_.setClipboard("--camera " + cameraText(orbit_));
    say("camera copied");
}

void Viewer::copyCameraJson() {
    requireOwnCamera();
    if (panes_.empty()) return;
    const Pane& pane = panes_.back();
    window_.setClipboard(cameraJson(orbit_, pane.viewWidth, pane.height));
    say("camera copied as JSON");
}

void Viewer::pasteCamera() {
    orbit_ = readCameraText(window_.clipboard());
    settings_.captureCamera = false;
}

void Viewer::lookFrom(double yaw, double pitch) {
    settings_.captureCamera = false;
    orbit_.yaw = std::remainder(yaw, 4 * kQuarter);
    orbit_.pitch = std::clamp(pitch, -kAbove, kAbove);
}

}  // namespace doppel
