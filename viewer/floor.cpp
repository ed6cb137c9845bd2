// The floor that the avatar stands on, and how high it is above it.
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "trainer/motion/retarget/ground.h"
#include "viewer/picture/floor.h"
#include "viewer/viewer.h"

namespace doppel {

namespace {

glm::dvec3 onFloor(const RigidMotion& floor, const float* vertex) {
    return floor.rotation * glm::dvec3(vertex[0], vertex[1], vertex[2]) + floor.translation;
}

}  // namespace

// Where the feet stand through the motion as it was opened, else in the pose that resets go back
// to, so that the floor keeps still while the avatar is posed.
void Viewer::findFloor() {
    const FloorOf now{motion() ? Pose{} : editor_->original(), editor_->betas(),
                      editor_->opening()};
    if (floorOf_ == now) return;
    floorOf_ = now;
    const Proportions& body = proportions_ = proportionsOf(avatar_->avatar.body, now.betas);
    if (motion()) {
        floor_ = groundOf(*motion(), body);
        return;
    }
    // Upright before the camera, whose y points down.
    GroundFrame floor{glm::dmat3(1, 0, 0, 0, -1, 0, 0, 0, -1), glm::dvec3(0)};
    Motion still;
    still.theta = {thetaOf(now.pose)};
    still.trans = {transOf(now.pose)};
    const PlacedJoints joints = placed(body, onGround(still, body, floor)[0]);
    floor.translation.y = -std::min(lowestOfSole(body, joints, 0), lowestOfSole(body, joints, 1));
    floor_ = floor;
}

// From the world of the poses that are shown then, which is a camera's where each frame has its
// own.
std::optional<RigidMotion> Viewer::worldToFloor(double time) {
    findFloor();
    if (!floor_ || !motion() || motion()->views.empty()) return floor_;
    const RigidMotion& seen = motion()->views[static_cast<size_t>(
        std::clamp<int64_t>(static_cast<int64_t>(time), 0, frameCount() - 1))];
    const glm::dmat3 turn = floor_->rotation * glm::transpose(seen.rotation);
    return RigidMotion{turn, floor_->translation - turn * seen.translation};
}

std::optional<double> Viewer::height(MeshKind mesh) {
    const std::optional<RigidMotion> floor = worldToFloor();
    if (!floor) return {};
    const std::vector<float> verts = scene_->vertices(mesh);
    double top = -INFINITY;
    for (size_t i = 0; i + 2 < verts.size(); i += 3)
        top = std::max(top, onFloor(*floor, &verts[i]).y);
    return top;
}

// A thin scale beside the body from the floor to as high as its highest point is.
void Viewer::drawHeight(const Pane& pane) {
    const std::optional<RigidMotion> floor = worldToFloor();
    const double top = height(pane.mesh).value_or(0);
    if (!floor || top <= 0) return;
    constexpr double kBeside = .12, kTick = .1;  // metres
    const glm::dmat3 back = glm::transpose(floor->rotation);
    const std::vector<float> verts = scene_->vertices(pane.mesh);
    // To the right as the picture shows it, along the floor.
    glm::dvec3 aside = floor->rotation * (glm::transpose(view().rotation) * glm::dvec3(1, 0, 0));
    aside.y = 0;
    if (glm::length(aside) < 1e-6) return;
    aside = glm::normalize(aside);
    const glm::dvec3 pelvis =
        floor->rotation * posed().position[joint::kPelvis] + floor->translation;
    double side = 0;
    for (size_t i = 0; i + 2 < verts.size(); i += 3)
        side = std::max(side, glm::dot(aside, onFloor(*floor, &verts[i]) - pelvis));
    const glm::dvec3 foot = glm::dvec3(pelvis.x, 0, pelvis.z) + (side + kBeside) * aside;
    const auto placeOf = [&](double height, double out) {
        const glm::dvec3 at = foot + glm::dvec3(0, height, 0) + out * aside;
        return onScreen(back * (at - floor->translation), pane);
    };
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    const auto unit = static_cast<float>(window_.unit());
    const auto toImGui = [](const glm::dvec3& p) {
        return ImVec2(static_cast<float>(p.x), static_cast<float>(p.y));
    };
    const auto drawLine = [&](const glm::dvec3& from, const glm::dvec3& to) {
        if (from.z <= 0 || to.z <= 0) return;
        list.AddLine(toImGui(from), toImGui(to), IM_COL32(0, 0, 0, 120), 3 * unit);
        list.AddLine(toImGui(from), toImGui(to), IM_COL32(255, 255, 255, 220), unit);
    };
    drawLine(placeOf(0, 0), placeOf(top, 0));
    for (int tick = 0; tick * kTick <= top; ++tick)
        drawLine(placeOf(tick * kTick, 0), placeOf(tick * kTick, tick % 5 == 0 ? .05 : .02));
    drawLine(placeOf(top, -.03), placeOf(top, .05));
    const glm::dvec3 end = placeOf(top, .05);
    const std::string words = fmt::format("{:.2f} m", top);
    // A picture too narrow for the scale has the number still.
    const float right = static_cast<float>((pane.x + pane.width) / window_.scale()) - 12 * unit -
                        ImGui::CalcTextSize(words.c_str()).x;
    if (end.z > 0)
        drawLabel({std::min(static_cast<float>(end.x) + 9 * unit, right),
                   static_cast<float>(end.y) - 8 * unit},
                  words);
}

}  // namespace doppel
