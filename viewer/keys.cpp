// Keys: Blender's habits where it has some.
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <cmath>
#include <numbers>

#include "viewer/viewer.h"

namespace doppel {

void Viewer::handleKeys() {
    const ImGuiIO& io = ImGui::GetIO();
    for (const KeyPress& press : window_.keys()) {
        framesToDraw_ = 3;
        if (question_) {
            // Whoever still holds a key has not read the question.
            if (press.repeated) continue;
            if (press.key == GLFW_KEY_ENTER || press.key == GLFW_KEY_KP_ENTER)
                answer(question_->answers.front().label);
            else if (press.key == GLFW_KEY_ESCAPE)
                answer(question_->answers.back().label);
            continue;
        }
        if (io.WantTextInput || (film_ && press.key != GLFW_KEY_ESCAPE)) continue;
        bool control = press.modifiers & (GLFW_MOD_CONTROL | GLFW_MOD_SUPER);
        bool shift = press.modifiers & GLFW_MOD_SHIFT;
        if (control) {
            if (press.key >= GLFW_KEY_1 && press.key <= GLFW_KEY_9) {
                const int digit = press.key - GLFW_KEY_0;
                attempt([&] { shift ? keepView(digit) : seeBookmark(digit); });
                lastTouched_ = Clock::now();
                continue;
            }
            switch (press.key) {
                case GLFW_KEY_Z:
                    shift ? redo() : undo();
                    break;
                case GLFW_KEY_Y:
                    redo();
                    break;
                case GLFW_KEY_C:
                    if (shift) {
                        copyCamera();
                        break;
                    }
                    window_.setClipboard(editor_->copy());
                    say("pose copied");
                    break;
                case GLFW_KEY_V:
                    attempt([&] {
                        if (shift)
                            pasteCamera();
                        else
                            editor_->paste(window_.clipboard());
                    });
                    break;
                case GLFW_KEY_S:
                    attempt([&] { shift ? chooseNewFile() : save(); });
                    break;
                case GLFW_KEY_O:
                    attempt([&] {
                        chooseFile(shift ? FileDialog::Asks::Folder : FileDialog::Asks::File);
                    });
                    break;
                case GLFW_KEY_EQUAL:
                case GLFW_KEY_KP_ADD:
                    setLook(settings_.theme, 1.1 * uiScale_);
                    break;
                case GLFW_KEY_MINUS:
                case GLFW_KEY_KP_SUBTRACT:
                    setLook(settings_.theme, uiScale_ / 1.1);
                    break;
                case GLFW_KEY_0:
                case GLFW_KEY_KP_0:
                    setLook(settings_.theme, 1);
                    break;
                case GLFW_KEY_Q:
                    window_.close();
                    break;
                default:
                    break;
            }
            continue;
        }
        double quarter = std::numbers::pi / 2;
        switch (press.key) {
            case GLFW_KEY_F:
            case GLFW_KEY_KP_DECIMAL:
                frameSelected();
                break;
            case GLFW_KEY_HOME:
                frameAll();
                break;
            case GLFW_KEY_1:
            case GLFW_KEY_KP_1:
                lookFrom(shift ? 2 * quarter : 0, 0);
                break;
            case GLFW_KEY_3:
            case GLFW_KEY_KP_3:
                lookFrom(shift ? -quarter : quarter, 0);
                break;
            case GLFW_KEY_7:
            case GLFW_KEY_KP_7:
                lookFrom(orbit_.yaw, shift ? -1.55 : 1.55);
                break;
            case GLFW_KEY_5:
            case GLFW_KEY_KP_5:
                orbit_.orthographic = !orbit_.orthographic;
                break;
            case GLFW_KEY_0:
            case GLFW_KEY_KP_0:
                if (motion() && !motion()->cameras.empty()) {
                    settings_.captureCamera = !settings_.captureCamera;
                    if (settings_.captureCamera && capture())
                        settings_.backdrop = Backdrop::Capture;
                }
                break;
            case GLFW_KEY_SPACE:
                play(!playing_);
                break;
            case GLFW_KEY_LEFT:
            case GLFW_KEY_RIGHT:
                step(press.key == GLFW_KEY_LEFT ? -1 : 1);
                break;
            case GLFW_KEY_M:
                editor_->mirror();
                break;
            case GLFW_KEY_R:
                if (shift)
                    editor_->resetPose();
                else if (std::optional<size_t> at = hovered_ ? hovered_ : selected_)
                    editor_->resetJoint(*at, editsBothSides(*at));
                break;
            case GLFW_KEY_P:
                if (std::optional<size_t> at = hovered_ ? hovered_ : selected_;
                    at && *at != joint::kPelvis)
                    if (!pins_.erase(*at)) pins_.insert(*at);
                break;
            case GLFW_KEY_K:
                setKey();
                break;
            case GLFW_KEY_W:
                settings_.wireframe = !settings_.wireframe;
                break;
            case GLFW_KEY_L:
                settings_.lit = !settings_.lit;
                break;
            case GLFW_KEY_G:
                settings_.floor = !settings_.floor;
                break;
            case GLFW_KEY_J:
                settings_.joints = !settings_.joints;
                break;
            case GLFW_KEY_B:
                nextSplit();
                break;
            case GLFW_KEY_I:
                toggleInspector();
                break;
            case GLFW_KEY_N:
            case GLFW_KEY_TAB:
                settings_.panel = !settings_.panel;
                break;
            case GLFW_KEY_H:
            case GLFW_KEY_F1:
                settings_.help = !settings_.help;
                break;
            case GLFW_KEY_F12:
                attempt([&] { saveScreenshot(freeName("doppel", ".png")); });
                break;
            case GLFW_KEY_ESCAPE:
                if (drag_ == Drag::Joint || drag_ == Drag::Ring) {
                    editor_->cancelGesture();
                    drag_ = Drag::None;
                } else if (film_) {
                    cancelFilm();
                } else {
                    selected_.reset();
                    inspected_.reset();
                    settings_.help = false;
                }
                break;
            default:
                break;
        }
        lastTouched_ = Clock::now();
    }
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

void Viewer::copyCamera() {
    window_.setClipboard("--camera " + cameraText(orbit_));
    say("camera copied");
}

void Viewer::pasteCamera() {
    orbit_ = readCameraText(window_.clipboard());
    settings_.captureCamera = false;
}

void Viewer::lookFrom(double yaw, double pitch) {
    settings_.captureCamera = false;
    orbit_.yaw = yaw;
    orbit_.pitch = pitch;
}

}  // namespace doppel
