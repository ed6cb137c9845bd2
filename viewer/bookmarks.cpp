// Views that are kept: Ctrl + Shift + a digit keeps the camera, Ctrl + the digit brings it back.
#include <imgui.h>

#include <algorithm>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

void Viewer::keepView(int digit) {
    if (settings_.captureCamera)
        throwInput("a bookmark keeps the viewer's own camera; 0 leaves the capture's");
    Bookmark& kept = preferences_.bookmarks[digit];
    if (kept.name.empty()) kept.name = fmt::format("view {}", digit);
    kept.camera = cameraText(orbit_);
    writePreferences(options_.state, preferences_);
    say(fmt::format("Ctrl+{} brings this view back", digit));
}

void Viewer::seeBookmark(int digit) {
    const auto kept = preferences_.bookmarks.find(digit);
    if (kept == preferences_.bookmarks.end())
        throwInput("there is no view {0}; Ctrl+Shift+{0} keeps one", digit);
    orbit_ = readCameraText(kept->second.camera);
    settings_.captureCamera = false;
}

void Viewer::drawBookmarks() {
    int removed = 0, free = 1;
    for (auto& [digit, kept] : preferences_.bookmarks) {
        if (free == digit) ++free;
        ImGui::PushID(digit);
        if (button(fmt::format("see {}", digit).c_str(),
                   ("Looks from there (Ctrl + digit): " + kept.camera).c_str()))
            attempt([&, d = digit] { seeBookmark(d); });
        ImGui::SameLine();
        std::array<char, kLongestBookmark + 1> name{};
        std::ranges::copy(kept.name, name.begin());
        const ImGuiStyle& style = ImGui::GetStyle();
        ImGui::PushItemWidth(
            -(ImGui::CalcTextSize("forget").x + 2 * style.FramePadding.x + style.ItemSpacing.x));
        if (ImGui::InputText("##name", name.data(), name.size())) kept.name = name.data();
        if (ImGui::IsItemDeactivatedAfterEdit()) writePreferences(options_.state, preferences_);
        noteItem(fmt::format("name of {}", digit));
        tip("What this view is called.");
        ImGui::PopItemWidth();
        ImGui::SameLine();
        if (button("forget", "Takes this view from the list.")) removed = digit;
        ImGui::PopID();
    }
    if (removed > 0) {
        preferences_.bookmarks.erase(removed);
        writePreferences(options_.state, preferences_);
    }
    if (button("keep this view",
               "Keeps the camera under the next free digit (Ctrl + Shift + digit).",
               free <= kMostBookmarks))
        attempt([&] { keepView(free); });
}

}  // namespace doppel
