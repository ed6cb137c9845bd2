// A walk through the scene, as Blender's: the mouse looks around, keys go. No button is held.
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>

#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr double kPace = 1.2;                // metres a second
constexpr double kFast = 4, kSlow = 1. / 4;  // times that, with Shift and with Alt
constexpr double kLongestTurn = .1;          // seconds: after one that took longer nobody jumps

// A key, and where it leads: to the right, down and ahead.
struct Step {
    int key;
    glm::dvec3 to;
};
constexpr Step kSteps[] = {
    {'W', {0, 0, 1}},
    {'S', {0, 0, -1}},
    {'A', {-1, 0, 0}},
    {'D', {1, 0, 0}},
    {'E', {0, -1, 0}},
    {'Q', {0, 1, 0}},
    {GLFW_KEY_UP, {0, 0, 1}},
    {GLFW_KEY_DOWN, {0, 0, -1}},
    {GLFW_KEY_LEFT, {-1, 0, 0}},
    {GLFW_KEY_RIGHT, {1, 0, 0}},
};

}  // namespace

void Viewer::beginWalk() {
    if (drag_ != Drag::None || panes_.empty()) return;
    noteCamera(true);
    walk_ = Walk{.began = orbit_, .captureCamera = settings_.captureCamera, .last = Clock::now()};
    dragPane_ = panes_.front();
    if (settings_.captureCamera) leaveCaptureCamera();
    orbit_.orthographic = false;  // nothing comes nearer without perspective
    drag_ = Drag::Walk;
    window_.holdMouse(true);
    mouse_ = window_.mouse();
}

// stay: where it has led; else where it began.
void Viewer::endWalk(bool stay) {
    if (!stay) {
        orbit_ = walk_->began;
        settings_.captureCamera = walk_->captureCamera;
    }
    walk_.reset();
    window_.holdMouse(false);
    mouse_ = window_.mouse();
    drag_ = Drag::None;
    lastTouched_ = Clock::now();
    framesToDraw_ = 3;
}

// Whether a walk takes this key.
bool Viewer::typesIntoWalk(const Chord& chord) {
    if (!walk_) return false;
    const bool enter = chord.code == GLFW_KEY_ENTER || chord.code == GLFW_KEY_KP_ENTER;
    const bool control = chord.modifiers & GLFW_MOD_CONTROL;
    // What Ctrl begins, a dialog for one, needs the mouse.
    if (enter || control) endWalk(true);
    return enter || (!control && std::ranges::count(kSteps, chord.code, &Step::key) > 0);
}

void Viewer::advanceWalk() {
    const glm::dvec2 before = std::exchange(mouse_, window_.mouse());
    if (question_ || ImGui::IsMouseClicked(0)) return endWalk(true);
    if (ImGui::IsMouseClicked(1)) return endWalk(false);
    const glm::dvec2 moved = (mouse_ - before) * window_.scale();
    if (moved != glm::dvec2(0)) orbit_.look(moved.x, moved.y, dragPane_.height);

    const auto now = Clock::now();
    const double passed =
        std::min(std::chrono::duration<double>(now - walk_->last).count(), kLongestTurn);
    walk_->last = now;
    glm::dvec3 way(0);
    for (const Step& step : kSteps)
        if (window_.isDown(step.key)) way += step.to;
    walk_->goes = way != glm::dvec3(0);
    if (!walk_->goes) return;
    const double pace = ImGui::GetIO().KeyShift ? kFast : ImGui::GetIO().KeyAlt ? kSlow : 1;
    orbit_.walk(glm::normalize(way) * (kPace * pace * passed));
}

}  // namespace doppel
