// The mouse.
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "viewer/overlays.h"
#include "viewer/pose/ground_contact.h"
#include "viewer/pose/stepping.h"
#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr double kPickRadius = 14, kRingPick = 7;  // window units
constexpr double kClick = 4;                       // that a click moves at most
constexpr double kDegrees = 180 / std::numbers::pi;
constexpr double kSnap = 5 / kDegrees;  // what a ring turns by
constexpr double kWheelStep = 30;       // pixels that a turn of the wheel pans and orbits

// How far a turn goes about an axis of length one, radians; the one nearest to `about`.
double twistAbout(const glm::dquat& turn, const glm::dvec3& axis, double about) {
    const double twist = 2 * std::atan2(glm::dot({turn.x, turn.y, turn.z}, axis), turn.w);
    constexpr double kTurn = 2 * std::numbers::pi;
    return twist + kTurn * std::round((about - twist) / kTurn);
}

}  // namespace

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
    if (!pane || pane->other || !handles()) return std::nullopt;
    PosedSkeleton body = posed();
    std::optional<size_t> best;
    double least = INFINITY;
    for (size_t j = 0; j < joint::kCount; ++j) {
        glm::dvec3 at = onScreen(body.position[j], *pane);
        double distance = glm::distance(glm::dvec2(at), glm::dvec2(x, y));
        if (at.z <= 0 || distance > kPickRadius * window_.unit()) continue;
        double score = distance + at.z;  // a metre of depth is worth a pixel
        if (score < least) {
            least = score;
            best = j;
        }
    }
    return best;
}

glm::dmat3 Viewer::ringAxes(const PosedSkeleton& body) const {
    const size_t j = selected_.value_or(0);
    const int parent = skeleton().parents[j];
    switch (settings_.ringAxes) {
        case RingAxes::Own:
            return body.rotation[j];
        case RingAxes::Parents:
            return parent < 0 ? glm::dmat3(1) : body.rotation[static_cast<size_t>(parent)];
        case RingAxes::Views:
            break;
    }
    return glm::transpose(view().rotation);
}

// A circle about the selected joint's axis, window coordinates.
std::vector<glm::dvec2> Viewer::ring(int axis, const Pane& pane) const {
    PosedSkeleton body = posed();
    size_t j = selected_.value_or(0);
    glm::dvec3 centre = body.position[j];
    double depth = onScreen(centre, pane).z;
    double radius = kRingRadius * window_.unit() * window_.scale() * depth / cameraOf(pane).fx;
    const glm::dmat3 axes = ringAxes(body);
    glm::dvec3 u = axes[(axis + 1) % 3], v = axes[(axis + 2) % 3];
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
    if (!pane || pane->other || !selected_ || !handles()) return std::nullopt;
    std::optional<RingHit> hit;
    const double ringRadius = kRingRadius * window_.unit();
    double least = kRingPick * window_.unit();
    const glm::dmat3 axes = ringAxes(posed());
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
            if (speed < ringRadius / 2)
                tangent =
                    speed > 0 ? tangent * (ringRadius / 2 / speed) : glm::dvec2(ringRadius / 2, 0);
            hit = RingHit{axis, axes[axis], tangent};
        }
    }
    return hit;
}

void Viewer::beginJointDrag(size_t joint, const std::string& what) {
    noteCamera(true);
    selected_ = joint;
    dragBegan_ = editor_->pose();
    dragPoint_ = posed().position[joint];
    play(false);
    editor_->beginGesture(what + jointName(joint));
    dragGoal_ = dragPoint_;
}

void Viewer::dragJoint() {
    glm::dvec2 moved = (mouse_ - dragStart_) * window_.scale();
    glm::dvec3 goal = movedInPlane(dragPoint_, moved.x, moved.y, view(), cameraOf(dragPane_));
    if (goal == dragGoal_) return;
    dragGoal_ = goal;
    const size_t joint = *selected_;
    const std::optional<Limb> limb = limbOf(skeleton(), joint);
    if (limb && settings_.fk[static_cast<size_t>(*limb)]) {
        editor_->setPose(
            finished(pointBone(skeleton(), dragBegan_, joint, goal), dragBegan_, joint));
        return;
    }
    PosedSkeleton began = forwardKinematics(skeleton(), dragBegan_);
    std::vector<IkTarget> targets{{.joint = joint, .position = goal}};
    // Both sides pull at the trunk, which so leans forward and back but to neither.
    const bool both = editsBothSides(joint);
    if (both)
        targets.push_back({.joint = oppositeJoint(joint),
                           .position = placeAcross(skeleton(), began, joint, goal)});
    for (size_t pin : pinsOfDrag(began)) targets.push_back(pinnedAt(began, pin));
    const Pose solved = solvedAboveFloor(targets, both ? 2 : 1);
    editor_->setPose(both ? mirroredAcross(skeleton(), solved, dragBegan_, joint) : solved);
}

// The pins, and the feet that stand on the floor where it holds them, but for the leg that is
// dragged.
std::set<size_t> Viewer::pinsOfDrag(const PosedSkeleton& began) {
    std::set<size_t> pins = pins_;
    if (settings_.holdFeet)
        if (const std::optional<RigidMotion> floor = worldToFloor())
            for (size_t ankle : standingAnkles(proportions_, began, *floor)) {
                const size_t hip = ankle == joint::kLeftAnkle ? joint::kLeftHip : joint::kRightHip;
                const bool dragged = skeleton().hangsOn(*selected_, hip) ||
                                     (editsBothSides(*selected_) &&
                                      skeleton().hangsOn(oppositeJoint(*selected_), hip));
                if (!dragged) pins.insert(ankle);
            }
    pins.erase(*selected_);
    return pins;
}

// Inverse kinematics from where the drag began. The floor, where it is a limit, lifts the first
// `dragged` targets by what would be below it.
Pose Viewer::solvedAboveFloor(std::vector<IkTarget> targets, size_t dragged) {
    const IkOptions options{.limits = settings_.limits, .balance = settings_.balance};
    const auto solve = [&] {
        if (!feetStep(targets)) return solveIk(skeleton(), dragBegan_, targets, options);
        return solveWithSteps(
            skeleton(), dragBegan_, targets, {joint::kLeftAnkle, joint::kRightAnkle},
            glm::transpose(worldToFloor()->rotation) * glm::dvec3(0, 1, 0), options);
    };
    Pose solved = solve();
    const std::optional<RigidMotion> floor = settings_.aboveFloor ? worldToFloor() : std::nullopt;
    if (!floor) return solved;
    const auto lowestOf = [&](const Pose& pose) {
        return lowestPoint(proportions_, forwardKinematics(skeleton(), pose), *floor);
    };
    // What was below it before the drag may stay there.
    const double least = std::min(0., lowestOf(dragBegan_));
    const glm::dvec3 up = glm::transpose(floor->rotation) * glm::dvec3(0, 1, 0);
    constexpr int kMostLifts = 6;
    constexpr double kClose = 5e-4;  // metres
    for (int i = 0; i < kMostLifts; ++i) {
        const double below = least - lowestOf(solved);
        if (below < kClose) break;
        for (size_t k = 0; k < dragged; ++k) targets[k].position += below * up;
        solved = solve();
    }
    return solved;
}

// Both feet are held by the floor, and by nothing else.
bool Viewer::feetStep(std::span<const IkTarget> targets) const {
    const auto held = [&](size_t ankle) {
        return !pins_.contains(ankle) && std::ranges::any_of(targets, [&](const IkTarget& target) {
            return target.pinned && target.joint == ankle;
        });
    };
    return settings_.holdFeet && settings_.steps && held(joint::kLeftAnkle) &&
           held(joint::kRightAnkle);
}

bool Viewer::editsBothSides(size_t joint) const {
    return settings_.symmetric && oppositeJoint(joint) != joint &&
           !pins_.contains(oppositeJoint(joint));
}

Pose Viewer::finished(const Pose& pose, const Pose& began, size_t joint) const {
    const Pose allowed = settings_.limits ? clampToLimits(pose, began) : pose;
    return editsBothSides(joint) ? mirroredAcross(skeleton(), allowed, began, joint) : allowed;
}

void Viewer::endDrag() {
    if (walk_) return endWalk(true);
    if (drag_ == Drag::Joint || drag_ == Drag::Ring) editor_->endGesture();
    drag_ = Drag::None;
    modal_.reset();
}

void Viewer::dragRing() {
    glm::dvec2 moved = mouse_ - dragStart_;
    double angle = modal_ ? modalAngle()
                          : glm::dot(moved, dragRing_.tangent) /
                                glm::dot(dragRing_.tangent, dragRing_.tangent);
    const bool typed = modal_ && !modal_->typed.empty();
    if (!typed && preferences_.snap != ImGui::GetIO().KeyCtrl)
        angle = std::round(angle / kSnap) * kSnap;
    const size_t joint = *selected_;
    const Pose pose = finished(
        rotateJoint(skeleton(), dragBegan_, joint, dragRing_.direction, angle), dragBegan_, joint);
    editor_->setPose(pose);
    dragAsked_ = angle;
    const glm::dquat before =
        glm::quat_cast(forwardKinematics(skeleton(), dragBegan_).rotation[joint]);
    const glm::dquat after = glm::quat_cast(forwardKinematics(skeleton(), pose).rotation[joint]);
    dragTurned_ = twistAbout(after * glm::conjugate(before), dragRing_.direction, angle);
}

std::string Viewer::turnedText() const {
    if (drag_ != Drag::Ring) return {};
    const double turned = kDegrees * dragTurned_;
    const bool held = std::abs(turned - kDegrees * dragAsked_) > .1;
    // No "-0.0".
    return fmt::format("{:.1f}\u00b0{}", std::abs(turned) < .05 ? 0. : turned,
                       held ? ", its limit" : "");
}

int Viewer::heldModifiers() {
    const ImGuiIO& io = ImGui::GetIO();
    return (io.KeyCtrl || io.KeySuper ? GLFW_MOD_CONTROL : 0) | (io.KeyShift ? GLFW_MOD_SHIFT : 0) |
           (io.KeyAlt ? GLFW_MOD_ALT : 0);
}

// What the button that went down does to the camera.
std::optional<Viewer::Drag> Viewer::cameraDrag() const {
    constexpr std::array<int, 3> kDrags{kLeftDrag, kRightDrag, kMiddleDrag};  // ImGui's order
    for (int button = 0; button < 3; ++button) {
        if (!ImGui::IsMouseClicked(button)) continue;
        const auto action = keys_.actionOf({kDrags[static_cast<size_t>(button)], heldModifiers()});
        if (action == Action::Orbit) return Drag::Orbit;
        if (action == Action::Pan) return Drag::Pan;
        if (action == Action::Zoom) return Drag::Dolly;
    }
    return std::nullopt;
}

bool Viewer::onHandle() const {
    return hovered_ || ringAt(mouse_.x, mouse_.y) || onDivider(mouse_.x);
}

// The wheel, or two fingers on a touchpad, which go sideways as well.
void Viewer::turnWheel() {
    const ImGuiIO& io = ImGui::GetIO();
    glm::dvec2 turned(io.MouseWheelH, io.MouseWheel);
    if (turned == glm::dvec2(0)) return;
    std::optional<Action> action;
    if (std::abs(turned.x) > std::abs(turned.y))
        action = keys_.actionOf({kSidewaysWheel, heldModifiers()});
    if (!action) action = keys_.actionOf({kWheel, heldModifiers()});
    if (!action) return;
    if (settings_.captureCamera) leaveCaptureCamera();
    if (action == Action::Zoom) {
        dollyToMouse(std::pow(0.9, turned.y));
    } else if (action == Action::Pan) {
        orbit_.pan(kWheelStep * turned.x, kWheelStep * turned.y, dragPane_.height);
    } else {
        orbit_.orbit(kWheelStep * turned.x, kWheelStep * turned.y, dragPane_.height);
    }
    lastTouched_ = Clock::now();
}

void Viewer::handleMouse() {
    if (walk_) return advanceWalk();
    const ImGuiIO& io = ImGui::GetIO();
    glm::dvec2 before = mouse_;
    mouse_ = {io.MousePos.x, io.MousePos.y};
    glm::dvec2 moved = mouse_ - before;
    if (drag_ == Drag::None) {
        hovered_.reset();
        if (io.WantCaptureMouse || question_) return;
        hovered_ = jointAt(mouse_.x, mouse_.y);
        const Pane* pane = paneAt(mouse_.x, mouse_.y);
        if (!pane) return;
        dragPane_ = *pane;
        dragStart_ = mouse_;
        dragMoved_ = false;
        const bool left = ImGui::IsMouseClicked(0);
        // With Alt the camera goes where a joint is under the mouse, too.
        std::optional<Drag> turn = cameraDrag();
        if (turn && left && !io.KeyAlt && onHandle()) turn.reset();
        if (turn) {
            drag_ = *turn;
            // A click that inspects looks through it.
            if (settings_.captureCamera && !(left && inspecting())) leaveCaptureCamera();
        } else if (left && hovered_) {
            beginJointDrag(*hovered_);
            drag_ = Drag::Joint;
        } else if (std::optional<RingHit> hit = left ? ringAt(mouse_.x, mouse_.y) : std::nullopt) {
            beginJointDrag(*selected_, "turn ");
            dragRing_ = *hit;
            dragAsked_ = dragTurned_ = 0;
            drag_ = Drag::Ring;
        } else if (left && onDivider(mouse_.x)) {
            drag_ = Drag::Divider;
        } else if (left) {
            drag_ = Drag::Click;
        }
        turnWheel();
        if (drag_ == Drag::None) return;
        moved = {};
    }
    if (moved != glm::dvec2(0)) lastTouched_ = Clock::now();
    dragMoved_ |= glm::distance(mouse_, dragStart_) > kClick * window_.unit();
    const bool turns = drag_ == Drag::Orbit || drag_ == Drag::Pan || drag_ == Drag::Dolly;
    if (turns && dragMoved_ && settings_.captureCamera) leaveCaptureCamera();
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
            dragJoint();
            break;
        case Drag::Ring:
            dragRing();
            break;
        case Drag::Divider:
            dragDivider();
            break;
        case Drag::Click:
        case Drag::Walk:
        case Drag::None:
            break;
    }
    if (modal_ && ImGui::IsMouseClicked(1)) {
        editor_->cancelGesture();
        endDrag();
    } else if (modal_ ? ImGui::IsMouseClicked(0) : !ImGui::IsAnyMouseDown()) {
        // A click into the empty.
        if ((drag_ == Drag::Orbit || drag_ == Drag::Click) && !dragMoved_) {
            selected_.reset();
            if (inspecting()) inspectAt(mouse_.x, mouse_.y);
        }
        endDrag();
        lastTouched_ = Clock::now();
        framesToDraw_ = 3;
    }
}

// What is under the mouse stays there.
void Viewer::dollyToMouse(double factor) {
    const double scale = window_.scale();
    orbit_.dollyAt(factor, mouse_.x * scale - dragPane_.viewX - dragPane_.viewWidth / 2.0,
                   mouse_.y * scale - dragPane_.y - dragPane_.height / 2.0, dragPane_.height);
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

}  // namespace doppel
