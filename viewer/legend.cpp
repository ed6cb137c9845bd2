// What the surface's colours mean, in the picture's lower right corner.
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "viewer/picture/legend.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

ImU32 packed(const LegendColour& colour) {
    const auto byte = [](double value) { return static_cast<int>(std::lround(255 * value)); };
    return IM_COL32(byte(colour[0]), byte(colour[1]), byte(colour[2]), 255);
}

// At the window's cursor; a patch is as wide as it is high.
void drawBar(const std::vector<LegendColour>& colours, float width, float height) {
    const ImVec2 at = ImGui::GetCursorScreenPos();
    ImDrawList& list = *ImGui::GetWindowDrawList();
    if (colours.size() == 1) {
        list.AddRectFilled(at, {at.x + height, at.y + height}, packed(colours[0]));
        ImGui::Dummy({height, height});
        return;
    }
    const float part = width / static_cast<float>(colours.size() - 1);
    for (size_t i = 0; i + 1 < colours.size(); ++i) {
        const float x = at.x + part * static_cast<float>(i);
        const ImU32 left = packed(colours[i]), right = packed(colours[i + 1]);
        list.AddRectFilledMultiColor({x, at.y}, {x + part, at.y + height}, left, right, right,
                                     left);
    }
    ImGui::Dummy({width, height});
}

}  // namespace

void Viewer::drawLegend() {
    if (panes_.empty()) return;
    const std::vector<LegendRow> rows = legendOf(settings_.paint, avatar_->avatar);
    if (rows.empty()) return;
    const Pane& pane = panes_.back();
    const auto scale = static_cast<float>(window_.scale());
    const auto unit = static_cast<float>(window_.unit());
    // Beside the atlas where that is in the corner.
    const auto inset = static_cast<float>(shadeOptions(pane).inset);
    const ImVec2 corner{(static_cast<float>(pane.x + pane.width) - inset) / scale - 8 * unit,
                        static_cast<float>(pane.y + pane.height) / scale - 8 * unit};
    ImGui::SetNextWindowPos(corner, ImGuiCond_Always, {1, 1});
    ImGui::SetNextWindowBgAlpha(.85f);
    ImGui::Begin("legend", nullptr,
                 kFixed | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoInputs |
                     ImGuiWindowFlags_NoFocusOnAppearing);
    const float height = ImGui::GetFontSize();
    for (const LegendRow& row : rows) {
        const bool patch = row.colours.size() == 1;
        if (!patch) {
            ImGui::TextUnformatted(row.name.c_str());
            noteItem(row.name);
        }
        const float words = ImGui::CalcTextSize(row.low.c_str()).x +
                            ImGui::CalcTextSize(row.high.c_str()).x + height;
        const float width = std::max(150 * unit, words);
        drawBar(row.colours, width, height * (patch ? .8f : .6f));
        if (patch) {
            ImGui::SameLine();
            ImGui::TextUnformatted(row.name.c_str());
            noteItem(row.name);
            continue;
        }
        const float left = ImGui::GetCursorPosX();
        ImGui::TextUnformatted(row.low.c_str());
        ImGui::SameLine(left + width - ImGui::CalcTextSize(row.high.c_str()).x);
        ImGui::TextUnformatted(row.high.c_str());
        noteItem(row.high);
    }
    ImGui::End();
}

}  // namespace doppel
