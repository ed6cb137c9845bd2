// What is drawn over the picture: joints, bones, rings, names.
#include <imgui.h>

#include <algorithm>
#include <array>

#include "viewer/overlays.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

ImVec2 toImGui(const glm::dvec2& p) { return {static_cast<float>(p.x), static_cast<float>(p.y)}; }

}  // namespace

void Viewer::drawLabel(const glm::vec2& at, const std::string& words) const {
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    const auto unit = static_cast<float>(window_.unit());
    const ImVec2 size = ImGui::CalcTextSize(words.c_str());
    list.AddRectFilled({at.x - 5 * unit, at.y - 2 * unit},
                       {at.x + size.x + 5 * unit, at.y + size.y + 2 * unit},
                       IM_COL32(18, 19, 22, 190), 4 * unit);
    list.AddText({at.x, at.y}, IM_COL32(255, 255, 255, 235), words.c_str());
}

void Viewer::drawOverlays() {
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    double scale = window_.scale();
    const auto unit = static_cast<float>(window_.unit());
    const std::vector<std::string> names = paneNames();
    for (size_t i = 0; i < panes_.size() && panes_.size() > 1; ++i) {
        const auto x = static_cast<float>(panes_[i].x / scale);
        const auto bottom = static_cast<float>(panes_[i].height / scale);
        if (i > 0) {  // to be seen on any background
            list.AddLine({x, 0}, {x, bottom}, IM_COL32(18, 19, 22, 160), 3);
            list.AddLine({x, 0}, {x, bottom}, IM_COL32(255, 255, 255, 200), 1);
        }
        if (i < names.size()) drawLabel({x + 12 * unit, bottom - 54 * unit}, names[i]);
    }
    if (const std::optional<double> line = dividerAt()) {
        const bool hot = drag_ == Drag::Divider ||
                         (drag_ == Drag::None && paneAt(mouse_.x, mouse_.y) && onDivider(mouse_.x));
        const ImVec2 grip{static_cast<float>(*line),
                          static_cast<float>(panes_[1].height / scale) / 2};
        list.AddCircleFilled(grip, (hot ? 9.f : 7.f) * unit, IM_COL32(18, 19, 22, 220));
        list.AddCircle(grip, (hot ? 9.f : 7.f) * unit, IM_COL32(255, 255, 255, 230), 0,
                       1.5f * unit);
        const auto pick = static_cast<float>(kDividerPick) * unit;
        tipOver("Drag it: what is compared is to its left and to its right.", {grip.x - pick, 0},
                {grip.x + pick, 2 * grip.y});
    }
    if (!panes_.empty()) drawPersonNames(panes_[0]);
    if (settings_.floor)
        for (const Pane& pane : panes_)
            if (!pane.other) drawHeight(pane);
    if (inspecting())
        for (const Pane& pane : panes_)
            if (!pane.other) drawInspected(pane);
    // They stay while the panel is used: whoever turns a joint there looks for it here.
    if (!handles()) return;
    PosedSkeleton body = posed();
    for (const Pane& pane : panes_) {
        if (pane.other) continue;
        list.PushClipRect(
            {float(pane.x / scale), float(pane.y / scale)},
            {float((pane.x + pane.width) / scale), float((pane.y + pane.height) / scale)});
        for (size_t j = 0; j < joint::kCount; ++j) {
            glm::dvec3 at = onScreen(body.position[j], pane);
            if (at.z <= 0) continue;
            if (skeleton().parents[j] >= 0) {
                glm::dvec3 up =
                    onScreen(body.position[static_cast<size_t>(skeleton().parents[j])], pane);
                if (up.z <= 0) continue;
                list.AddLine(toImGui(at), toImGui(up), IM_COL32(0, 0, 0, 60), 3 * unit);
                list.AddLine(toImGui(at), toImGui(up), IM_COL32(255, 255, 255, 110), 1.5f * unit);
            }
        }
        for (size_t j = 0; j < joint::kCount; ++j) {
            bool chosen = selected_ == j, hot = hovered_ == j;
            glm::dvec3 at = onScreen(body.position[j], pane);
            if (at.z <= 0) continue;
            float radius = unit * (hot ? 6.5f : chosen ? 5.5f : 3.5f);
            ImU32 colour = chosen ? kSelectedColour : hot ? kHoveredColour : kJointColour;
            list.AddCircleFilled(toImGui(at), radius + 1.5f * unit, kRim);
            list.AddCircleFilled(toImGui(at), radius, colour);
            if (pins_.contains(j)) {
                ImVec2 c = toImGui(at);
                const float side = 8 * unit;
                const ImVec2 low{c.x - side, c.y - side}, high{c.x + side, c.y + side};
                list.AddRect(low, high, kRim, 0, 0, 5 * unit);
                list.AddRect(low, high, kPinColour, 0, 0, 2 * unit);
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
                const float width = unit * (hot ? 3.0f : 1.8f);
                list.AddPolyline(points.data(), kRingPoints, kRim, ImDrawFlags_Closed,
                                 width + 2.5f * unit);
                list.AddPolyline(points.data(), kRingPoints, kRingColours[axis], ImDrawFlags_Closed,
                                 width);
            }
        }
        list.PopClipRect();
    }
    if (walk_) {
        const float top = settings_.figures ? 44 : 12;  // below those
        drawLabel({12 * unit, top * unit}, "W A S D: walk; E, Q: up, down; Shift: fast; Alt: slow");
        drawLabel({12 * unit, (top + 28) * unit}, "a click or Enter: stay; Escape: back");
    }
    std::string atMouse = turnedText();
    if (hovered_ && drag_ == Drag::None) {
        atMouse = jointName(*hovered_);
        std::ranges::replace(atMouse, '_', ' ');
    }
    if (atMouse.empty() || panes_.empty()) return;
    // Beside the panel and at the window's edges, too, all of it is seen.
    const auto right = static_cast<float>((panes_.back().x + panes_.back().width) / scale);
    const float most = right - ImGui::CalcTextSize(atMouse.c_str()).x - 6 * unit;
    drawLabel({std::min(static_cast<float>(mouse_.x) + 14 * unit, most),
               std::max(static_cast<float>(mouse_.y) - 22 * unit, 3 * unit)},
              atMouse);
}

}  // namespace doppel
