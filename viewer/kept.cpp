// What is kept to come back to: views, each under a digit, and poses, as stick figures seen
// from the front.
#include <imgui.h>

#include <algorithm>
#include <array>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

constexpr float kWidth = 56, kHeight = 72;  // of a figure, window units

// "Ctrl + 3" of "Ctrl + digit".
std::string withDigit(std::string keys, int digit) {
    constexpr std::string_view kWord = "digit";
    if (keys.ends_with(kWord))
        keys.replace(keys.size() - kWord.size(), kWord.size(), 1, static_cast<char>('0' + digit));
    return keys;
}

// Its joints within a box of kWidth by kHeight times `unit`, at `corner`.
void drawFigure(ImDrawList& list, const Skeleton& skeleton, Pose pose, ImVec2 corner, float unit) {
    pose.trans = {};
    const PosedSkeleton posed = forwardKinematics(skeleton, pose);
    glm::dvec2 low(1e9), high(-1e9);
    for (const glm::dvec3& place : posed.position) {
        low = glm::min(low, glm::dvec2(place));
        high = glm::max(high, glm::dvec2(place));
    }
    const glm::dvec2 box = glm::dvec2(kWidth - 14, kHeight - 18) * double(unit),
                     size = glm::max(high - low, glm::dvec2(1e-3));
    const double scale = std::min(box.x / size.x, box.y / size.y);
    const glm::dvec2 middle = glm::dvec2(corner.x, corner.y) +
                              glm::dvec2(kWidth, kHeight + 6) * double(unit) / 2. -
                              scale * (low + high) / 2.;
    const auto at = [&](size_t joint) {
        const glm::dvec2 place = middle + scale * glm::dvec2(posed.position[joint]);
        return ImVec2(static_cast<float>(place.x), static_cast<float>(place.y));
    };
    for (size_t j = 1; j < joint::kCount; ++j) {
        const ImU32 colour = oppositeJoint(j) == j  ? ImGui::GetColorU32(ImGuiCol_Text)
                             : oppositeJoint(j) > j ? IM_COL32(90, 150, 240, 255)   // her left
                                                    : IM_COL32(230, 140, 60, 255);  // and right
        list.AddLine(at(static_cast<size_t>(skeleton.parents[j])), at(j), colour, 2 * unit);
    }
    list.AddCircleFilled(at(joint::kHead), 4 * unit, ImGui::GetColorU32(ImGuiCol_Text));
}

}  // namespace

void Viewer::keepView(int digit) {
    if (settings_.captureCamera)
        throwInput("a bookmark keeps the viewer's own camera; {} leaves the capture's",
                   keys_.keyOf(Action::CaptureCamera));
    Bookmark& kept = preferences_.bookmarks[digit];
    if (kept.name.empty()) kept.name = fmt::format("view {}", digit);
    kept.camera = cameraText(orbit_);
    writePreferences(options_.state, preferences_);
    say(fmt::format("{} brings this view back", withDigit(keys_.keyOf(Action::SeeView), digit)));
}

void Viewer::seeBookmark(int digit) {
    const auto kept = preferences_.bookmarks.find(digit);
    if (kept == preferences_.bookmarks.end())
        throwInput("there is no view {}; {} keeps one", digit,
                   withDigit(keys_.keyOf(Action::KeepView), digit));
    orbit_ = readCameraText(kept->second.camera);
    settings_.captureCamera = false;
}

void Viewer::drawBookmarks() {
    int removed = 0, free = 1;
    for (auto& [digit, kept] : preferences_.bookmarks) {
        if (free == digit) ++free;
        ImGui::PushID(digit);
        if (button(fmt::format("see {}", digit).c_str(),
                   fmt::format("Looks from there ({}): {}",
                               withDigit(keys_.keyOf(Action::SeeView), digit), kept.camera)))
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
               keys_.tip("Keeps the camera under the next free digit", Action::KeepView),
               free <= kMostBookmarks))
        attempt([&] { keepView(free); });
    bool undone = preferences_.undoCamera;
    if (checkbox("undo the camera, too", "Undo also takes back how the camera was moved.", undone))
        undoCamera(undone);
}

void Viewer::drawKeptPoses() {
    const bool open = ImGui::CollapsingHeader("kept poses");
    noteItem("kept poses");
    tip("Poses for this avatar and all others: figures to choose from.");
    if (!open) return;
    if (button("keep this pose", "Adds what is seen to the figures below."))
        attempt([&] {
            poseTaken_ = library_.poses()[library_.keep(editor_->pose(), editor_->betas())].name;
        });
    const auto unit = static_cast<float>(window_.unit());
    const float space = ImGui::GetStyle().ItemSpacing.x, wide = ImGui::GetContentRegionAvail().x;
    const int perRow = std::max(1, static_cast<int>((wide + space) / (kWidth * unit + space)));
    std::string taken;
    int count = 0;
    for (const KeptPose& kept : library_.poses()) {
        if (count++ % perRow != 0) ImGui::SameLine();
        ImGui::PushID(kept.name.c_str());
        if (ImGui::InvisibleButton("figure", {kWidth * unit, kHeight * unit})) taken = kept.name;
        const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
        ImDrawList& list = *ImGui::GetWindowDrawList();
        list.AddRectFilled(
            low, high,
            ImGui::GetColorU32(ImGui::IsItemHovered() ? ImGuiCol_FrameBgHovered : ImGuiCol_FrameBg),
            3 * unit);
        if (kept.name == poseTaken_)
            list.AddRect(low, high, ImGui::GetColorU32(ImGuiCol_CheckMark), 3 * unit);
        drawFigure(list, skeleton(), kept.pose, low, unit);
        noteItem("pose: " + kept.name);
        tip(kept.name + ": takes how its joints are turned; with Shift, mirrored.");
        ImGui::PopID();
    }
    if (!taken.empty()) {
        const auto kept = std::ranges::find(library_.poses(), taken, &KeptPose::name);
        const Pose pose = withRotationsOf(editor_->pose(), kept->pose);
        play(false);
        editor_->setPose(ImGui::GetIO().KeyShift ? mirrored(pose) : pose, "take " + taken);
        poseTaken_ = taken;
    }
    const auto chosen = std::ranges::find(library_.poses(), poseTaken_, &KeptPose::name);
    if (chosen == library_.poses().end()) return;
    std::array<char, 64> name{};
    std::ranges::copy(poseNamed_.value_or(chosen->name), name.begin());
    const ImGuiStyle& style = ImGui::GetStyle();
    ImGui::PushItemWidth(
        -(ImGui::CalcTextSize("forget").x + 2 * style.FramePadding.x + style.ItemSpacing.x));
    if (ImGui::InputText("##pose", name.data(), name.size())) poseNamed_ = name.data();
    const bool named = ImGui::IsItemDeactivatedAfterEdit();
    noteItem("name of the pose");
    tip("What this pose is called.");
    ImGui::PopItemWidth();
    ImGui::SameLine();
    const bool forgotten = button("forget", "Takes this pose from the list.");
    if (named && poseNamed_) {
        attempt([&] {
            library_.rename(poseTaken_, *poseNamed_);
            poseTaken_ = *poseNamed_;
        });
        poseNamed_.reset();
    } else if (forgotten) {
        attempt([&] { library_.forget(poseTaken_); });
    }
}

}  // namespace doppel
