// The timeline below, the figures and messages in the corner, questions and help.
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

constexpr auto kTimelineHeight = float{Viewer::kTimelineHeight};

}  // namespace

void Viewer::drawTimeline() {
    ImVec2 size = ImGui::GetIO().DisplaySize;
    ImGui::SetNextWindowPos({0, size.y - kTimelineHeight});
    ImGui::SetNextWindowSize({size.x, kTimelineHeight});
    ImGui::Begin("timeline", nullptr, kFixed | ImGuiWindowFlags_NoScrollbar);
    int64_t count = frameCount();
    if (ImGui::Button(playing_ ? "pause" : " play ")) play(!playing_);
    ImGui::SameLine();
    ImGui::Checkbox("loop", &loop_);
    ImGui::SameLine();
    ImGui::PushItemWidth(110);
    slider("speed", speed_, 0.1, 4, "%.2f x");
    ImGui::PopItemWidth();
    ImGui::SameLine();
    double now = std::floor(timeline_);
    if (ImGui::Button("key here")) {
        editor_->setKeyframe(now);
        say(fmt::format("key at frame {:.0f}", now));
    }
    ImGui::SameLine();
    if (std::ranges::count(editor_->keyframes(), now, &Keyframe::time) > 0) {
        if (ImGui::Button("remove key")) editor_->removeKeyframe(now);
        ImGui::SameLine();
    }
    if (motion() && hasKeys()) {
        double fade = editor_->fade();
        ImGui::PushItemWidth(80);
        if (slider("fade", fade, 0, 60, "%.0f frames")) editor_->setFade(std::round(fade));
        if (ImGui::IsItemActivated()) editor_->beginGesture("fade");
        if (ImGui::IsItemDeactivated()) editor_->endGesture();
        ImGui::PopItemWidth();
        ImGui::SameLine();
    }
    if (count <= 1)
        ImGui::TextDisabled("no motion: open one, or set keys at different frames");
    else
        ImGui::TextDisabled("%s", motion() ? motion()->name.c_str() : "keyframes");

    int last = static_cast<int>(timelineEnd());
    int frame = static_cast<int>(now);
    ImGui::PushItemWidth(-1);
    ImVec2 at = ImGui::GetCursorScreenPos();
    float width = ImGui::GetContentRegionAvail().x;
    if (ImGui::SliderInt("##frame", &frame, 0, std::max(last, 1), "frame %d")) {
        play(false);
        timeline_ = std::clamp(frame, 0, last);
        lastTouched_ = Clock::now();
    }
    ImGui::PopItemWidth();
    for (const Keyframe& key : editor_->keyframes()) {
        float x = at.x + width * static_cast<float>(key.time / std::max(last, 1));
        ImGui::GetWindowDrawList()->AddTriangleFilled({x - 4, at.y - 5}, {x + 4, at.y - 5},
                                                      {x, at.y + 1}, IM_COL32(255, 180, 60, 255));
    }
    ImGui::End();
}

void Viewer::drawStatus() {
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    auto text = [&](float x, float y, ImU32 colour, const std::string& words) {
        list.AddText({x + 1, y + 1}, IM_COL32(0, 0, 0, 200), words.c_str());
        list.AddText({x, y}, colour, words.c_str());
    };
    std::string figures = fmt::format("pose {:.0f} ms, picture {:.0f} ms, window {:.0f} ms",
                                      times_.pose, times_.draw, times_.show);
    if (interacting() && times_.fps > 0)
        figures = fmt::format("{:.0f} fps: ", times_.fps) + figures;
    bool painting = painter_->busy();
    if (times_.paint > 0) figures += fmt::format(", texture {:.0f} ms", times_.paint);
    if (settings_.figures) text(12, 10, IM_COL32(200, 205, 215, 220), figures);
    if (painting && settings_.figures)
        text(12, 26, IM_COL32(255, 200, 110, 255), "painting the texture ...");
    if (film_)
        text(12, 42, IM_COL32(255, 110, 110, 255),
             fmt::format("drawing the film: {:.0f} %  (Escape gives up)", 100.0 * filmProgress()));
    messagesDrawn_ = 0;
    for (const Message& message : messages_)
        if (messageVisible(message))
            text(12, 58 + 16 * static_cast<float>(messagesDrawn_++),
                 message.wrong ? IM_COL32(255, 120, 110, 255) : IM_COL32(160, 230, 160, 255),
                 message.text);
    if (settings_.figures && !settings_.help && pictures_ < 400 && !panes_.empty())
        text(12, ImGui::GetIO().DisplaySize.y - kTimelineHeight - 22, IM_COL32(200, 205, 215, 160),
             "H: help");
}

void Viewer::drawQuestion() {
    if (!question_ && !questionOpen_) return;
    constexpr const char* kName = "Doppel asks";
    if (!questionOpen_) ImGui::OpenPopup(kName);
    questionOpen_ = true;
    ImVec2 size = ImGui::GetIO().DisplaySize;
    ImGui::SetNextWindowPos({size.x / 2, size.y / 2}, ImGuiCond_Always, {.5f, .5f});
    std::string chosen;
    if (ImGui::BeginPopupModal(kName, nullptr,
                               ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove |
                                   ImGuiWindowFlags_NoSavedSettings)) {
        if (question_) {
            ImGui::PushTextWrapPos(std::min(420.0f, size.x - 40));
            ImGui::TextUnformatted(question_->text.c_str());
            ImGui::PopTextWrapPos();
            ImGui::Spacing();
            for (size_t i = 0; i < question_->answers.size(); ++i) {
                if (i > 0) ImGui::SameLine();
                if (ImGui::Button(question_->answers[i].label.c_str()))
                    chosen = question_->answers[i].label;
            }
        } else {
            // It was answered. Dear ImGui takes what is no longer drawn for open all the same.
            ImGui::CloseCurrentPopup();
            questionOpen_ = false;
        }
        ImGui::EndPopup();
    }
    if (!chosen.empty()) answer(chosen);
}

void Viewer::drawHelp() {
    if (!settings_.help) return;
    ImGui::SetNextWindowPos({40, 80}, ImGuiCond_Appearing);
    ImGui::Begin("Help", &settings_.help,
                 ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoSavedSettings);
    const char* rows[][2] = {
        {"drag a joint", "moves it, the limb follows"},
        {"drag a ring", "turns the selected joint"},
        {"left or middle drag", "orbit"},
        {"right or Shift drag", "pan"},
        {"wheel, Ctrl + middle drag", "nearer, farther; with Shift or sideways: pan"},
        {"F, Home", "see all of it"},
        {"1  3  7  (Shift: opposite)", "front, side, top"},
        {"5", "orthographic"},
        {"0", "the capture's camera"},
        {"P", "pin the joint under the mouse, or let it go"},
        {"R, Shift + R", "reset the joint, the whole pose"},
        {"M", "mirror"},
        {"Ctrl + Z, Ctrl + Shift + Z", "undo, redo"},
        {"Ctrl + C, Ctrl + V", "copy, paste the pose as JSON"},
        {"Space, left, right", "play, one frame back, on"},
        {"K", "key here; edits over a motion are keys of themselves"},
        {"Ctrl + S", "save what is seen, as a poses.npz"},
        {"B", "side by side: meshes, textures, off"},
        {"W  L  J", "wireframe, light, joints"},
        {"N, Tab", "panel"},
        {"F12", "save the picture"},
        {"Escape", "give up a drag or a film, deselect"},
        {"Ctrl + Q", "quit"},
    };
    if (ImGui::BeginTable("keys", 2)) {
        for (const auto& row : rows) {
            ImGui::TableNextRow();
            ImGui::TableNextColumn();
            ImGui::TextUnformatted(row[0]);
            ImGui::TableNextColumn();
            ImGui::TextDisabled("%s", row[1]);
        }
        ImGui::EndTable();
    }
    ImGui::End();
}

}  // namespace doppel
