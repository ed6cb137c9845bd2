// Drags that a key begins and a click ends, as Blender's G and R do: no button is held meanwhile.
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <cmath>
#include <cstdlib>
#include <numbers>

#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr size_t kLongestNumber = 8;

}  // namespace

void Viewer::beginModalDrag(Drag drag) {
    const std::optional<size_t> at = selected_ ? selected_ : hovered_;
    if (drag_ != Drag::None) return;
    if (!at || !handles()) throwInput("no joint is selected; a click on one selects it");
    const Pane* pane = paneAt(mouse_.x, mouse_.y);
    dragPane_ = pane && !pane->other ? *pane : panes_.front();
    dragStart_ = mouse_;
    dragMoved_ = false;
    selected_ = at;
    beginJointDrag(*at, drag == Drag::Ring ? "turn " : "move ");
    if (drag == Drag::Ring) {
        // About the line of sight, until X, Y or Z chooses one of the rings' axes.
        const glm::dmat3 axes = glm::transpose(view().rotation);
        dragRing_ = {kNoRing, axes[2], {}};
        dragAsked_ = dragTurned_ = 0;
    }
    drag_ = drag;
    modal_ = Modal{};
}

// Whether a drag that a key began takes this key: Enter ends it; X, Y, Z choose the axis of a turn,
// and digits say how far it goes.
bool Viewer::typesIntoDrag(const Chord& chord) {
    if (!modal_) return false;
    if (chord.code == GLFW_KEY_ENTER || chord.code == GLFW_KEY_KP_ENTER) {
        endDrag();
        return true;
    }
    if (drag_ != Drag::Ring || chord.modifiers != 0) return false;
    std::string& typed = modal_->typed;
    if (chord.code >= GLFW_KEY_X && chord.code <= GLFW_KEY_Z) {
        const int axis = chord.code - GLFW_KEY_X;
        dragRing_ = {axis, ringAxes(forwardKinematics(skeleton(), dragBegan_))[axis], {}};
    } else if (chord.code >= '0' && chord.code <= '9') {
        if (typed.size() < kLongestNumber) typed += static_cast<char>(chord.code);
    } else if (chord.code >= GLFW_KEY_KP_0 && chord.code <= GLFW_KEY_KP_9) {
        if (typed.size() < kLongestNumber)
            typed += static_cast<char>('0' + chord.code - GLFW_KEY_KP_0);
    } else if (chord.code == '.' || chord.code == GLFW_KEY_KP_DECIMAL) {
        if (typed.find('.') == std::string::npos) typed += '.';
    } else if (chord.code == '-' || chord.code == GLFW_KEY_KP_SUBTRACT) {
        if (typed.starts_with('-'))
            typed.erase(0, 1);
        else
            typed.insert(0, 1, '-');
    } else if (chord.code == GLFW_KEY_BACKSPACE) {
        if (!typed.empty()) typed.pop_back();
    } else {
        return false;
    }
    lastTouched_ = Clock::now();
    dragRing();
    return true;
}

// How far the mouse has gone round the joint since the drag began, radians, about the ring's axis.
double Viewer::modalAngle() {
    if (!modal_->typed.empty())
        return std::strtod(modal_->typed.c_str(), nullptr) * std::numbers::pi / 180;
    const glm::dvec2 centre = onScreen(dragPoint_, dragPane_), arm = mouse_ - centre;
    constexpr double kTooNear = 2;  // pixels, where a direction means nothing
    if (glm::length(arm) > kTooNear) {
        const double direction = std::atan2(arm.y, arm.x);
        if (modal_->direction)
            modal_->turned += std::remainder(direction - *modal_->direction, 2 * std::numbers::pi);
        modal_->direction = direction;
    }
    // Clockwise on the picture is about what points into it.
    return (view().rotation * dragRing_.direction).z < 0 ? -modal_->turned : modal_->turned;
}

}  // namespace doppel
