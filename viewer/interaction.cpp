// Mouse and keys: Blender's habits for the middle button, glTF viewers' for the others.
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr double kPickRadius = 14, kRingRadius = 74, kRingPick = 7;  // window coordinates
constexpr int kRingPoints = 64;

ImVec2 toImGui(const glm::dvec2& p) { return {static_cast<float>(p.x), static_cast<float>(p.y)}; }

bool isPinnable(size_t j) { return j != joint::kPelvis; }

}  // namespace

// ---- keys ---------------------------------------------------------------------------------------

void Viewer::handleKeys() {
    const ImGuiIO& io = ImGui::GetIO();
    for (const KeyPress& press : window_.keys()) {
        framesToDraw_ = 3;
        if (io.WantTextInput || (film_ && press.key != GLFW_KEY_ESCAPE)) continue;
        bool control = press.modifiers & (GLFW_MOD_CONTROL | GLFW_MOD_SUPER);
        bool shift = press.modifiers & GLFW_MOD_SHIFT;
        if (control) {
            switch (press.key) {
                case GLFW_KEY_Z:
                    shift ? editor_->redo() : editor_->undo();
                    break;
                case GLFW_KEY_Y:
                    editor_->redo();
                    break;
                case GLFW_KEY_C:
                    window_.setClipboard(editor_->copy());
                    say("pose copied");
                    break;
                case GLFW_KEY_V:
                    attempt([&] { editor_->paste(window_.clipboard()); });
                    break;
                case GLFW_KEY_S:
                    attempt([&] { savePoses(freeName("poses", ".npz")); });
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
            case GLFW_KEY_HOME:
            case GLFW_KEY_KP_DECIMAL:
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
                if (motion_ && !motion_->cameras.empty()) {
                    settings_.captureCamera = !settings_.captureCamera;
                    if (settings_.captureCamera && capture_) settings_.backdrop = Backdrop::Capture;
                }
                break;
            case GLFW_KEY_SPACE:
                playing_ = !playing_ && frameCount() > 1;
                break;
            case GLFW_KEY_LEFT:
            case GLFW_KEY_RIGHT:
                playing_ = false;
                timeline_ =
                    std::clamp(std::floor(timeline_) + (press.key == GLFW_KEY_LEFT ? -1 : 1), 0.0,
                               static_cast<double>(std::max<int64_t>(frameCount() - 1, 0)));
                break;
            case GLFW_KEY_M:
                editor_->mirror();
                break;
            case GLFW_KEY_R:
                if (shift)
                    editor_->resetPose();
                else if (std::optional<size_t> at = hovered_ ? hovered_ : selected_)
                    editor_->resetJoint(*at);
                break;
            case GLFW_KEY_P:
                if (std::optional<size_t> at = hovered_ ? hovered_ : selected_;
                    at && isPinnable(*at))
                    if (!pins_.erase(*at)) pins_.insert(*at);
                break;
            case GLFW_KEY_K:
                editor_->setKeyframe(std::floor(timeline_));
                say(fmt::format("key at frame {:.0f}", std::floor(timeline_)));
                break;
            case GLFW_KEY_W:
                settings_.wireframe = !settings_.wireframe;
                break;
            case GLFW_KEY_L:
                settings_.lit = !settings_.lit;
                break;
            case GLFW_KEY_J:
                settings_.joints = !settings_.joints;
                break;
            case GLFW_KEY_B:
                settings_.split = settings_.split == Split::None     ? Split::Meshes
                                  : settings_.split == Split::Meshes ? Split::Textures
                                                                     : Split::None;
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
    orbit_.frame(scene_->vertices(settings_.mesh), panes_[0].width, panes_[0].height);
}

void Viewer::lookFrom(double yaw, double pitch) {
    settings_.captureCamera = false;
    orbit_.yaw = yaw;
    orbit_.pitch = pitch;
}

// ---- mouse --------------------------------------------------------------------------------------

const Pane* Viewer::paneAt(double x, double y) const {
    double scale = window_.scale();
    for (const Pane& pane : panes_)
        if (x * scale >= pane.x && x * scale < pane.x + pane.width && y * scale >= pane.y &&
            y * scale < pane.y + pane.height)
            return &pane;
    return nullptr;
}

// In window coordinates, and the depth.
glm::dvec3 Viewer::onScreen(const glm::dvec3& world, const Pane& pane) const {
    glm::dvec3 at = projected(world, view(), cameraOf(pane));
    double scale = window_.scale();
    return {(at.x + pane.x) / scale, (at.y + pane.y) / scale, at.z};
}

// The nearest joint under the cursor, seen or hidden; of two in one place the nearer to the eye.
std::optional<size_t> Viewer::jointAt(double x, double y) const {
    const Pane* pane = paneAt(x, y);
    if (!pane || !settings_.joints) return std::nullopt;
    PosedSkeleton body = posed();
    std::optional<size_t> best;
    double least = INFINITY;
    for (size_t j = 0; j < joint::kCount; ++j) {
        glm::dvec3 at = onScreen(body.position[j], *pane);
        double distance = glm::distance(glm::dvec2(at), glm::dvec2(x, y));
        if (at.z <= 0 || distance > kPickRadius) continue;
        double score = distance + at.z;  // a metre of depth is worth a pixel
        if (score < least) {
            least = score;
            best = j;
        }
    }
    return best;
}

// A circle about the selected joint's axis, window coordinates.
std::vector<glm::dvec2> Viewer::ring(int axis, const Pane& pane) const {
    PosedSkeleton body = posed();
    size_t j = selected_.value_or(0);
    glm::dvec3 centre = body.position[j];
    double depth = onScreen(centre, pane).z;
    double radius = kRingRadius * window_.scale() * depth / cameraOf(pane).fx;
    glm::dvec3 u = body.rotation[j][(axis + 1) % 3], v = body.rotation[j][(axis + 2) % 3];
    std::vector<glm::dvec2> points;
    for (int i = 0; i < kRingPoints; ++i) {
        double angle = 2 * std::numbers::pi * i / kRingPoints;
        points.emplace_back(
            onScreen(centre + radius * (std::cos(angle) * u + std::sin(angle) * v), pane));
    }
    return points;
}

std::optional<Viewer::RingHit> Viewer::ringAt(double x, double y) const {
    const Pane* pane = paneAt(x, y);
    if (!pane || !selected_ || !settings_.joints) return std::nullopt;
    std::optional<RingHit> hit;
    double least = kRingPick;
    for (int axis = 0; axis < 3; ++axis) {
        std::vector<glm::dvec2> points = ring(axis, *pane);
        for (size_t i = 0; i < points.size(); ++i) {
            glm::dvec2 a = points[i], b = points[(i + 1) % points.size()], along = b - a;
            double length = glm::dot(along, along);
            double t = length > 0
                           ? std::clamp(glm::dot(glm::dvec2(x, y) - a, along) / length, 0.0, 1.0)
                           : 0;
            double distance = glm::distance(glm::dvec2(x, y), a + t * along);
            if (distance >= least) continue;
            least = distance;
            // Seen from its edge a ring hardly moves: there the mouse turns it all the same.
            glm::dvec2 tangent = along * (kRingPoints / (2 * std::numbers::pi));
            double speed = glm::length(tangent);
            if (speed < kRingRadius / 2)
                tangent = speed > 0 ? tangent * (kRingRadius / 2 / speed)
                                    : glm::dvec2(kRingRadius / 2, 0);
            hit = RingHit{axis, tangent};
        }
    }
    return hit;
}

void Viewer::beginJointDrag(size_t joint) {
    selected_ = joint;
    dragBegan_ = editor_->pose();
    dragPoint_ = posed().position[joint];
    playing_ = false;
    editor_->beginGesture(std::string("move ") + jointName(joint));
}

void Viewer::dragJoint() {
    glm::dvec2 moved = (mouse_ - dragStart_) * window_.scale();
    glm::dvec3 goal = movedInPlane(dragPoint_, moved.x, moved.y, view(), cameraOf(dragPane_));
    PosedSkeleton began = forwardKinematics(skeleton(), dragBegan_);
    std::vector<IkTarget> targets{{.joint = *selected_, .position = goal}};
    for (size_t pin : pins_)
        if (pin != *selected_) targets.push_back(pinnedAt(began, pin));
    editor_->setPose(solveIk(skeleton(), editor_->pose(), targets,
                             {.began = &dragBegan_, .limits = settings_.limits}));
}

void Viewer::dragRing() {
    glm::dvec2 moved = mouse_ - dragStart_;
    double angle =
        glm::dot(moved, dragRing_.tangent) / glm::dot(dragRing_.tangent, dragRing_.tangent);
    glm::dvec3 axis =
        forwardKinematics(skeleton(), dragBegan_).rotation[*selected_][dragRing_.axis];
    Pose turned = rotateJoint(skeleton(), dragBegan_, *selected_, axis, angle);
    editor_->setPose(settings_.limits ? clampToLimits(turned, dragBegan_) : turned);
}

void Viewer::handleMouse() {
    const ImGuiIO& io = ImGui::GetIO();
    glm::dvec2 before = mouse_;
    mouse_ = {io.MousePos.x, io.MousePos.y};
    glm::dvec2 moved = mouse_ - before;
    if (drag_ == Drag::None) {
        hovered_.reset();
        if (io.WantCaptureMouse || film_) return;
        hovered_ = jointAt(mouse_.x, mouse_.y);
        const Pane* pane = paneAt(mouse_.x, mouse_.y);
        if (!pane) return;
        dragPane_ = *pane;
        dragStart_ = mouse_;
        bool left = ImGui::IsMouseClicked(0), right = ImGui::IsMouseClicked(1),
             middle = ImGui::IsMouseClicked(2);
        if (left && hovered_) {
            beginJointDrag(*hovered_);
            drag_ = Drag::Joint;
        } else if (std::optional<RingHit> hit = left ? ringAt(mouse_.x, mouse_.y) : std::nullopt) {
            dragRing_ = *hit;
            dragBegan_ = editor_->pose();
            playing_ = false;
            editor_->beginGesture(std::string("turn ") + jointName(*selected_));
            drag_ = Drag::Ring;
        } else if (left || right || middle) {
            drag_ = middle && io.KeyCtrl                         ? Drag::Dolly
                    : right || ((left || middle) && io.KeyShift) ? Drag::Pan
                                                                 : Drag::Orbit;
            if (settings_.captureCamera) leaveCaptureCamera();
        }
        if (io.MouseWheel != 0 || io.MouseWheelH != 0) {
            if (settings_.captureCamera) leaveCaptureCamera();
            // Two fingers sideways, or with Shift in any direction, pan; else nearer and farther.
            if (io.KeyShift || std::abs(io.MouseWheelH) > std::abs(io.MouseWheel))
                orbit_.pan(30.0 * static_cast<double>(io.MouseWheelH),
                           30.0 * static_cast<double>(io.MouseWheel), dragPane_.height);
            else
                orbit_.dolly(std::pow(0.9, static_cast<double>(io.MouseWheel)));
            lastTouched_ = Clock::now();
        }
        if (drag_ == Drag::None) return;
        moved = {};
    }
    if (moved != glm::dvec2(0)) lastTouched_ = Clock::now();
    double scale = window_.scale();
    switch (drag_) {
        case Drag::Orbit:
            orbit_.orbit(moved.x * scale, moved.y * scale, dragPane_.height);
            break;
        case Drag::Pan:
            orbit_.pan(moved.x * scale, moved.y * scale, dragPane_.height);
            break;
        case Drag::Dolly:
            orbit_.dolly(std::pow(1.01, moved.y));
            break;
        case Drag::Joint:
            if (mouse_ != dragStart_ || editor_->pose() != dragBegan_) dragJoint();
            break;
        case Drag::Ring:
            dragRing();
            break;
        case Drag::None:
            break;
    }
    if (!io.MouseDown[0] && !io.MouseDown[1] && !io.MouseDown[2]) {
        if (drag_ == Drag::Joint || drag_ == Drag::Ring) editor_->endGesture();
        drag_ = Drag::None;
        lastTouched_ = Clock::now();
        framesToDraw_ = 3;
    }
}

// Orbiting starts from where the capture's camera stood.
void Viewer::leaveCaptureCamera() {
    Camera own = cameraOf(dragPane_);
    settings_.captureCamera = false;
    glm::dvec3 pelvis = posed().position[joint::kPelvis];
    orbit_.yaw = orbit_.pitch = 0;
    orbit_.orthographic = false;
    orbit_.distance = std::max(pelvis.z, 0.3);
    orbit_.target = {0, 0, orbit_.distance};
    orbit_.fieldOfView = std::clamp(2 * std::atan(dragPane_.height / (2 * own.fy)), 0.05, 2.5);
}

// ---- what is drawn over the picture -------------------------------------------------------------

void Viewer::drawOverlays() {
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    double scale = window_.scale();
    if (panes_.size() == 2) {
        auto x = static_cast<float>(panes_[1].x / scale);
        auto bottom = static_cast<float>(panes_[1].height / scale);
        list.AddLine({x, 0}, {x, bottom}, IM_COL32(255, 255, 255, 160), 1);
        bool meshes = settings_.split == Split::Meshes;
        const char* left = meshes ? "body" : "coarse texture";
        const char* right = meshes ? "refined mesh" : "refined texture";
        list.AddText({12, bottom - 42}, IM_COL32(255, 255, 255, 220), left);
        list.AddText({x + 12, bottom - 42}, IM_COL32(255, 255, 255, 220), right);
    }
    bool near = paneAt(mouse_.x, mouse_.y) && !ImGui::GetIO().WantCaptureMouse;
    bool edits = drag_ == Drag::Joint || drag_ == Drag::Ring;
    if (!settings_.joints || film_ || (!near && !edits && !selected_)) return;
    PosedSkeleton body = posed();
    for (const Pane& pane : panes_) {
        list.PushClipRect(
            {float(pane.x / scale), float(pane.y / scale)},
            {float((pane.x + pane.width) / scale), float((pane.y + pane.height) / scale)});
        for (size_t j = 0; j < joint::kCount && (near || edits); ++j) {
            glm::dvec3 at = onScreen(body.position[j], pane);
            if (at.z <= 0) continue;
            if (skeleton().parents[j] >= 0) {
                glm::dvec3 up =
                    onScreen(body.position[static_cast<size_t>(skeleton().parents[j])], pane);
                if (up.z > 0)
                    list.AddLine(toImGui(at), toImGui(up), IM_COL32(255, 255, 255, 70), 1.5f);
            }
        }
        for (size_t j = 0; j < joint::kCount; ++j) {
            bool chosen = selected_ == j, hot = hovered_ == j;
            if (!near && !edits && !chosen) continue;
            glm::dvec3 at = onScreen(body.position[j], pane);
            if (at.z <= 0) continue;
            float radius = hot ? 6.5f : chosen ? 5.5f : 3.5f;
            ImU32 colour = chosen ? IM_COL32(255, 180, 60, 255)
                           : hot  ? IM_COL32(255, 230, 150, 255)
                                  : IM_COL32(120, 190, 255, 220);
            list.AddCircleFilled(toImGui(at), radius + 1.5f, IM_COL32(0, 0, 0, 150));
            list.AddCircleFilled(toImGui(at), radius, colour);
            if (pins_.contains(j)) {
                ImVec2 c = toImGui(at);
                list.AddRect({c.x - 8, c.y - 8}, {c.x + 8, c.y + 8}, IM_COL32(255, 90, 90, 255), 0,
                             0, 2);
            }
        }
        if (selected_) {
            std::optional<RingHit> hit =
                drag_ == Drag::None ? ringAt(mouse_.x, mouse_.y) : std::nullopt;
            for (int axis = 0; axis < 3; ++axis) {
                if (drag_ == Drag::Joint || (drag_ == Drag::Ring && dragRing_.axis != axis))
                    continue;
                std::array<ImVec2, kRingPoints> points;
                std::vector<glm::dvec2> at = ring(axis, pane);
                std::ranges::transform(at, points.begin(), toImGui);
                bool hot = (hit && hit->axis == axis) || drag_ == Drag::Ring;
                ImU32 alpha = hot ? 255 : 170;
                ImU32 colour = axis == 0   ? IM_COL32(235, 80, 80, alpha)
                               : axis == 1 ? IM_COL32(100, 210, 100, alpha)
                                           : IM_COL32(90, 140, 255, alpha);
                list.AddPolyline(points.data(), kRingPoints, colour, ImDrawFlags_Closed,
                                 hot ? 3.0f : 1.8f);
            }
        }
        list.PopClipRect();
    }
    if (hovered_ && drag_ == Drag::None) {
        glm::dvec2 at = mouse_ + glm::dvec2(14, -18);
        std::string name = jointName(*hovered_);
        std::ranges::replace(name, '_', ' ');
        list.AddText(toImGui(at + glm::dvec2(1)), IM_COL32(0, 0, 0, 255), name.c_str());
        list.AddText(toImGui(at), IM_COL32(255, 255, 255, 255), name.c_str());
    }
}

}  // namespace doppel
