#include "viewer/widgets.h"

#include <GLFW/glfw3.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <utility>

namespace doppel {

namespace {

std::vector<DrawnItem>& list() {
    static std::vector<DrawnItem> items;
    return items;
}

constexpr std::chrono::milliseconds kTipAfter{600};

// The item that the mouse rests on.
struct Hover {
    ImVec2 place{};
    std::chrono::steady_clock::time_point since{};
    bool now = false, before = false;  // in this frame and in the one before
    int shown = 0;                     // frames with its tip
};
Hover& hovered() {
    static Hover hover;
    return hover;
}

float widthOf(std::string_view text) {
    return ImGui::CalcTextSize(text.data(), text.data() + text.size(), true).x;
}

// place: of what it is about.
void showTip(std::string_view text, ImVec2 place) {
    const auto now = std::chrono::steady_clock::now();
    Hover& hover = hovered();
    if (!hover.before || hover.place.x != place.x || hover.place.y != place.y) hover = {place, now};
    hover.now = true;
    if (now - hover.since < kTipAfter) return;
    ++hover.shown;
    ImGui::BeginTooltip();
    ImGui::PushTextWrapPos(20 * ImGui::GetFontSize());
    ImGui::TextUnformatted(text.data(), text.data() + text.size());
    ImGui::PopTextWrapPos();
    if (!tipPending()) noteItem(text);
    ImGui::EndTooltip();
}

}  // namespace

const std::vector<DrawnItem>& drawnItems() { return list(); }
void forgetItems() {
    list().clear();
    hovered().before = std::exchange(hovered().now, false);
}

StatusColours statusColours(Theme theme) {
    if (theme == Theme::Light)
        return {.backing = IM_COL32(250, 250, 252, 215),
                .plain = IM_COL32(40, 44, 52, 255),
                .good = IM_COL32(10, 105, 40, 255),
                .bad = IM_COL32(180, 25, 20, 255)};
    return {.backing = IM_COL32(18, 19, 22, 215),
            .plain = IM_COL32(205, 210, 220, 255),
            .good = IM_COL32(160, 230, 160, 255),
            .bad = IM_COL32(255, 130, 120, 255)};
}

void noteItem(std::string_view label, std::string_view words, float besides) {
    const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
    DrawnItem item{std::string(label), {low.x, low.y}, {high.x, high.y}};
    const float left = ImGui::GetWindowPos().x, right = left + ImGui::GetWindowSize().x;
    item.cut = item.low.x < left - .5f || item.high.x > right + .5f;
    if (!words.empty())
        item.cut |= widthOf(words) + 2 * ImGui::GetStyle().FramePadding.x + besides >
                    ImGui::CalcItemWidth() + .5f;
    list().push_back(std::move(item));
}

void noteRow(std::string_view label) {
    noteItem(label);
    const float free = ImGui::GetWindowContentRegionMax().x - ImGui::GetWindowContentRegionMin().x;
    list().back().cut = widthOf(label) > free + .5f;
}

void tip(std::string_view text) {
    if (!text.empty() && ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled) &&
        !ImGui::IsMouseDown(0))
        showTip(text, ImGui::GetItemRectMin());
}

void tipOver(std::string_view text, ImVec2 low, ImVec2 high) {
    if (!ImGui::GetIO().WantCaptureMouse && !ImGui::IsMouseDown(0) &&
        ImGui::IsMouseHoveringRect(low, high, false))
        showTip(text, low);
}

// Dear ImGui measures a window in its first frame, and shows it in the next: until then a tip is
// no item that is drawn.
bool tipPending() { return hovered().now && hovered().shown < 3; }

bool button(const char* label, const std::string& does, bool enabled) {
    if (!enabled) ImGui::BeginDisabled();
    const bool pressed = ImGui::Button(label);
    if (!enabled) ImGui::EndDisabled();
    noteItem(label);
    tip(does);
    return pressed && enabled;
}

bool checkbox(const char* label, const std::string& does, bool& value) {
    const bool pressed = ImGui::Checkbox(label, &value);
    noteItem(label);
    tip(does);
    return pressed;
}

bool slider(const char* label, const std::string& does, int& value, int low, int high,
            const char* format) {
    const bool moved = ImGui::SliderInt(label, &value, low, high, format);
    noteItem(label);
    tip(does);
    return moved;
}

bool slider(const char* label, const std::string& does, double& value, double low, double high,
            const char* format) {
    const bool moved =
        ImGui::SliderScalar(label, ImGuiDataType_Double, &value, &low, &high, format);
    noteItem(label);
    tip(does);
    return moved;
}

void words(const std::string& text) {
    ImGui::PushTextWrapPos(0);
    ImGui::TextUnformatted(text.c_str());
    ImGui::PopTextWrapPos();
    noteItem(text);
}

void hint(const std::string& text) {
    ImGui::PushStyleColor(ImGuiCol_Text, ImGui::GetStyleColorVec4(ImGuiCol_TextDisabled));
    words(text);
    ImGui::PopStyleColor();
}

bool tab(const char* label, const std::string& does, bool show) {
    const bool open = ImGui::BeginTabItem(label, nullptr, show ? ImGuiTabItemFlags_SetSelected : 0);
    noteItem(label);
    tip(does);
    return open;
}

bool pathField(const std::string& does, std::span<char> text, std::span<const KeyPress> keys) {
    ImGui::PushItemWidth(-1);
    bool entered =
        ImGui::InputText("##path", text.data(), text.size(), ImGuiInputTextFlags_EnterReturnsTrue);
    // Dear ImGui looks at what is held, and misses a key that is down for less than a frame.
    entered |= ImGui::IsItemActive() && std::ranges::any_of(keys, [](const KeyPress& k) {
                   return k.key == GLFW_KEY_ENTER || k.key == GLFW_KEY_KP_ENTER;
               });
    noteItem("path");
    tip(does);
    ImGui::PopItemWidth();
    return entered;
}

std::filesystem::path typedPath(std::span<const char> text) {
    const std::string typed = text.data();
    const char* home = std::getenv("HOME");
    if (!home || (typed != "~" && !typed.starts_with("~/"))) return typed;
    return typed == "~" ? std::filesystem::path(home)
                        : std::filesystem::path(home) / typed.substr(2);
}

bool choose(const char* label, const std::string& does, const Choice* choices, size_t count,
            int& value) {
    const char* now = "";
    for (size_t i = 0; i < count; ++i)
        if (choices[i].value == value) now = choices[i].name;
    const bool open = ImGui::BeginCombo(label, now);
    if (!open) noteItem(label, now, ImGui::GetFrameHeight());
    if (!open) tip(does);
    if (!open) return false;
    bool changed = false;
    for (size_t i = 0; i < count; ++i) {
        if (ImGui::Selectable(choices[i].name, choices[i].value == value)) {
            changed = value != choices[i].value;
            value = choices[i].value;
        }
        noteRow(choices[i].name);
        tip(choices[i].does);
    }
    ImGui::EndCombo();
    return changed;
}

void beside(const char* nextLabel) {
    const ImGuiStyle& style = ImGui::GetStyle();
    const float needed = widthOf(nextLabel) + 2 * style.FramePadding.x + ImGui::GetFrameHeight() +
                         2 * style.ItemSpacing.x;
    const float right = ImGui::GetWindowPos().x + ImGui::GetWindowContentRegionMax().x;
    if (ImGui::GetItemRectMax().x + needed <= right) ImGui::SameLine();
}

}  // namespace doppel
