// What a training that goes on says of itself, in the picture's lower left corner.
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "trainer/data/progress.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

constexpr size_t kLossesShown = 6;
constexpr const char* kBetween = "   ";  // losses

// Logarithmic where all are above zero: losses fall by factors.
std::vector<double> heights(std::vector<double> values) {
    if (std::ranges::all_of(values, [](double value) { return value > 0; }))
        for (double& value : values) value = std::log(value);
    const auto [low, high] = std::ranges::minmax(values);
    const double from = low, range = high - low;
    for (double& value : values) value = range > 0 ? (value - from) / range : 0.5;
    return values;
}

// With new lines between losses where they are wider than that; Dear ImGui's own wrapping breaks
// numbers at their points.
std::string wrapped(const std::string& losses, float width) {
    std::string text, line;
    for (size_t from = 0; from < losses.size();) {
        const size_t end = std::min(losses.find(kBetween, from), losses.size());
        const std::string loss = losses.substr(from, end - from);
        const std::string longer = line.empty() ? loss : line + kBetween + loss;
        if (!line.empty() && ImGui::CalcTextSize(longer.c_str()).x > width) {
            text += line + "\n";
            line = loss;
        } else {
            line = longer;
        }
        from = end + std::string_view(kBetween).size();
    }
    return text + line;
}

}  // namespace

std::vector<std::string> Viewer::trainingLines() const {
    std::vector<std::string> lines;
    if (!training_.stage()) return lines;
    const StageRecord& stage = *training_.stage();
    std::string line =
        fmt::format("stage {}: step {} of {}", stage.stage, training_.done(), stage.steps);
    if (training_.stands())
        line += fmt::format("; no step for {}", clockText(training_.secondsSinceStep()));
    else if (training_.done() == stage.steps)
        line += "; preparing what follows";
    else if (const auto left = training_.secondsLeft())
        line += fmt::format(", {} left", clockText(*left));
    lines.push_back(line);
    std::string losses;
    for (size_t i = 0; i < std::min(kLossesShown, training_.latest().size()); ++i)
        losses += fmt::format("{}{} {:.3g}", i > 0 ? kBetween : "", training_.names()[i],
                              training_.latest()[i]);
    lines.push_back(losses.empty() ? "before its first step" : losses);
    if (!stage.device.empty()) lines.push_back(stage.device);
    return lines;
}

void Viewer::drawTraining() {
    trainingPlot_ = {};
    if (!settings_.training || panes_.empty()) return;
    std::vector<std::string> lines = trainingLines();
    if (lines.empty()) return;
    const auto unit = static_cast<float>(window_.unit());
    const auto right =
        static_cast<float>((panes_.back().x + panes_.back().width) / window_.scale());
    const float width =
                    std::min(std::clamp(.4f * right, 190 * unit, 300 * unit), right - 16 * unit),
                inner = width - 16 * unit;
    if (inner < 60 * unit) return;
    lines[1] = wrapped(lines[1], inner);
    const float gap = 4 * unit, plot = 56 * unit;
    float height = 2 * gap + plot;
    for (const std::string& line : lines)
        height += ImGui::CalcTextSize(line.c_str(), nullptr, false, inner).y + gap;
    // Above the line that says where the help is.
    const float bottom =
        static_cast<float>(panes_[0].height / window_.scale()) - ImGui::GetFontSize() - 22 * unit;
    const ImVec2 from{8 * unit, bottom - height}, to{from.x + width, bottom};
    if (from.y < 30 * unit) return;  // a window so low has no room for it
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    const StatusColours colours = statusColours(settings_.theme);
    list.AddRectFilled(from, to, colours.backing, 4 * unit);
    ImVec2 at{from.x + 8 * unit, from.y + gap};
    const auto text = [&](const std::string& words) {
        list.AddText(ImGui::GetFont(), ImGui::GetFontSize(), at, colours.plain, words.c_str(),
                     nullptr, inner);
        at.y += ImGui::CalcTextSize(words.c_str(), nullptr, false, inner).y + gap;
    };
    text(lines[0]);
    const Curve curve = thinned(training_.sums(), static_cast<size_t>(inner / unit));
    if (curve.value.size() > 1) {
        // The whole width is the whole stage.
        const double share =
            std::min(1., static_cast<double>(training_.sums().size()) /
                             static_cast<double>(std::max<int64_t>(1, training_.stage()->steps)));
        const std::vector<double> high = heights(curve.value);
        for (size_t i = 0; i < high.size(); ++i)
            trainingPlot_.push_back({at.x + static_cast<float>(share * curve.at[i]) * inner,
                                     at.y + static_cast<float>(1 - high[i]) * plot});
        std::vector<ImVec2> points;
        for (const glm::vec2& point : trainingPlot_) points.push_back({point.x, point.y});
        list.AddPolyline(points.data(), static_cast<int>(points.size()), colours.good, 0,
                         1.5f * unit);
    }
    list.AddLine({at.x, at.y + plot}, {at.x + inner, at.y + plot}, colours.plain, unit);
    at.y += plot + gap;
    for (size_t i = 1; i < lines.size(); ++i) text(lines[i]);
}

}  // namespace doppel
