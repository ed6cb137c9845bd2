// What is kept to come back to: views, each under a digit, and poses, as pictures.
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

constexpr float kWidth = 72, kHeight = 96;  // of a pose's picture, window units

// "Ctrl + 3" of "Ctrl + digit".
std::string withDigit(std::string keys, int digit) {
    constexpr std::string_view kWord = "digit";
    if (keys.ends_with(kWord))
        keys.replace(keys.size() - kWord.size(), kWord.size(), 1, static_cast<char>('0' + digit));
    return keys;
}

}  // namespace

void Viewer::requireOwnCamera() const {
    if (settings_.captureCamera)
        throwInput("this takes the viewer's own camera; {} leaves the capture's",
                   keys_.keyOf(Action::CaptureCamera));
}

void Viewer::keepView(int digit) {
    requireOwnCamera();
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

// In the avatar's own colours, without what it is shown with: they do not change with that.
void Viewer::usePosePictures() {
    const double scale = window_.unit() * window_.scale();
    const ImVec4 behind = ImGui::GetStyleColorVec4(ImGuiCol_FrameBg);
    posePictures_.use({.betas = editor_->betas(),
                       .width = static_cast<int>(std::lround(kWidth * scale)),
                       .height = static_cast<int>(std::lround(kHeight * scale)),
                       .behind = {behind.x, behind.y, behind.z},
                       .shade = {.paint = static_cast<uint32_t>(avatar_->textured ? kPaintTexture
                                                                                  : kPaintClay)}});
    poseDrawn_ = false;
}

// One of them is drawn in a frame, and none while something moves. Null: not yet.
const CanvasImage* Viewer::pictureOf(const KeptPose& kept) {
    if (const CanvasImage* image = posePictures_.find(kept.name, kept.pose)) return image;
    framesToDraw_ = std::max(framesToDraw_, 2);
    if (poseDrawn_ || interacting()) return nullptr;
    poseDrawn_ = true;
    useTexture(TextureKind::Coarse);
    posePictures_.draw(kept.name, kept.pose, *scene_);
    const Pose pose = editor_->pose();
    scene_->setPose(thetaOf(pose), transOf(pose), editor_->betas());
    return posePictures_.find(kept.name, kept.pose);
}

void Viewer::drawKeptPoses() {
    const bool open = ImGui::CollapsingHeader("kept poses");
    noteItem("kept poses");
    tip("Poses for this avatar and all others: pictures to choose from.");
    if (!open) return;
    if (button("keep this pose", "Adds what is seen to the pictures below."))
        attempt([&] {
            poseTaken_ = library_.poses()[library_.keep(editor_->pose(), editor_->betas())].name;
        });
    const auto unit = static_cast<float>(window_.unit());
    const float space = ImGui::GetStyle().ItemSpacing.x, wide = ImGui::GetContentRegionAvail().x;
    const int perRow = std::max(1, static_cast<int>((wide + space) / (kWidth * unit + space)));
    usePosePictures();
    std::string taken;
    int count = 0;
    for (const KeptPose& kept : library_.poses()) {
        if (count++ % perRow != 0) ImGui::SameLine();
        ImGui::PushID(kept.name.c_str());
        if (ImGui::InvisibleButton("figure", {kWidth * unit, kHeight * unit})) taken = kept.name;
        const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
        ImDrawList& list = *ImGui::GetWindowDrawList();
        if (ImGui::IsItemVisible()) {
            if (const CanvasImage* image = pictureOf(kept))
                // It is no texture of a GPU's, and is not written to.
                list.AddImage(const_cast<CanvasImage*>(image), low, high);
            else
                list.AddRectFilled(low, high, ImGui::GetColorU32(ImGuiCol_FrameBg));
        }
        if (kept.name == poseTaken_ || ImGui::IsItemHovered())
            list.AddRect(
                low, high,
                ImGui::GetColorU32(kept.name == poseTaken_ ? ImGuiCol_CheckMark : ImGuiCol_Text));
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
