// The timeline below, the figures and messages in the corner, questions and help.
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

constexpr size_t kMessagesShown = 4;

// 12.3 s, or 1:02.3.
std::string clock(double seconds) {
    const double minutes = std::floor(seconds / 60);
    return minutes > 0 ? fmt::format("{:.0f}:{:04.1f}", minutes, seconds - 60 * minutes)
                       : fmt::format("{:.2f} s", seconds);
}

}  // namespace

void Viewer::drawTimeline() {
    ImVec2 size = ImGui::GetIO().DisplaySize;
    const auto unit = static_cast<float>(window_.unit());
    const auto height = static_cast<float>(timelineHeight());
    ImGui::SetNextWindowPos({0, size.y - height});
    ImGui::SetNextWindowSize({size.x, height});
    ImGui::Begin("timeline", nullptr, kFixed | ImGuiWindowFlags_NoScrollbar);
    // What a narrow window has no room for: the speed first, then the fade, the clock last.
    const bool wide = size.x >= 760 * unit, wider = size.x >= 960 * unit;
    if (button(playing_ ? "pause" : " play ",
               keys_.tip("Plays the timeline, or stops", Action::Play)))
        play(!playing_);
    ImGui::SameLine();
    checkbox("loop", "After the last frame it begins again.", loop_);
    ImGui::SameLine();
    if (wider) {
        ImGui::PushItemWidth(90 * unit);
        slider("speed", "How fast it plays, times its own speed.", speed_, 0.1, 4, "%.2f x");
        ImGui::PopItemWidth();
        ImGui::SameLine();
    }
    const double now = std::floor(timeline_);
    if (button("key here", keys_.tip("Makes a key of the pose at this frame", Action::SetKey)))
        setKey();
    ImGui::SameLine();
    const bool onKey = std::ranges::count(editor_->keyframes(), now, &Keyframe::time) > 0;
    if (button("remove key", keys_.tip("Takes the key of this frame away", Action::RemoveKey),
               onKey))
        editor_->removeKeyframe(now);
    ImGui::SameLine();
    if (wide && motion() && hasKeys()) {
        double fade = editor_->layer().fade;
        ImGui::PushItemWidth(90 * unit);
        const bool changed =
            slider("fade", "How long an edit over a motion comes and goes, to both sides.", fade, 0,
                   60, "%.0f frames");
        if (ImGui::IsItemActivated()) editor_->beginGesture("fade");
        if (changed) editor_->setFade(std::round(fade));
        if (ImGui::IsItemDeactivated()) editor_->endGesture();
        ImGui::SameLine();
        static constexpr Choice kBlends[] = {
            {"adds", static_cast<int>(Layer::Blend::Add), "Joints go on moving below the edit."},
            {"overrides", static_cast<int>(Layer::Blend::Override),
             "Joints are held as they were set."}};
        int blend = static_cast<int>(editor_->layer().blend);
        if (choose(
                "##blend",
                "What an edit does to the motion: adds to how a joint moves, or overrides it, so "
                "that the joint is held as it was set. Joints that were not edited move as before.",
                kBlends, blend))
            editor_->setBlend(static_cast<Layer::Blend>(blend));
        ImGui::PopItemWidth();
        ImGui::SameLine();
    }
    const int last = static_cast<int>(timelineEnd());
    const std::string where = fmt::format("{:.0f} / {}   {} / {}   {:.4g} fps", now, last,
                                          clock(now / fps()), clock(last / fps()), fps());
    // To the right; the motion's name where there is room between.
    const float end = ImGui::GetWindowContentRegionMax().x,
                whereWidth = ImGui::CalcTextSize(where.c_str()).x, from = ImGui::GetCursorPosX();
    const std::string name = frameCount() > 1
                                 ? (motion() ? motion()->name : "keys")
                                 : "no motion: open one, or set keys at different frames";
    if (from + ImGui::CalcTextSize(name.c_str()).x + 24 * unit + whereWidth <= end) {
        ImGui::TextDisabled("%s", name.c_str());
        ImGui::SameLine();
    }
    if (from + whereWidth <= end) {
        ImGui::SetCursorPosX(end - whereWidth);
        ImGui::TextUnformatted(where.c_str());
        noteItem(where);
    } else {
        const std::string frames = fmt::format("{:.0f} / {}", now, last);
        ImGui::TextUnformatted(frames.c_str());
        noteItem(frames);
    }

    int frame = static_cast<int>(now);
    ImGui::PushItemWidth(-1);
    const ImVec2 at = ImGui::GetCursorScreenPos();
    const float width = ImGui::GetContentRegionAvail().x;
    if (ImGui::SliderInt("##frame", &frame, 0, std::max(last, 1), "frame %d")) {
        play(false);
        timeline_ = std::clamp(frame, 0, last);
        lastTouched_ = Clock::now();
    }
    noteItem("frame");
    tip(keys_.tip("The frame that is shown", Action::NextFrame));
    ImGui::PopItemWidth();
    // Above the slider's grab, which is as wide as a frame.
    constexpr float kPadding = 2;  // of Dear ImGui's sliders
    const float inner = width - 2 * kPadding;
    const float grab = std::min(inner, std::max(inner / static_cast<float>(std::max(last, 1) + 1),
                                                ImGui::GetStyle().GrabMinSize));
    for (const Keyframe& key : editor_->keyframes()) {
        const float x = at.x + kPadding + grab / 2 +
                        (inner - grab) * static_cast<float>(key.time / std::max(last, 1));
        const ImVec2 left{x - 4 * unit, at.y - 4 * unit}, right{x + 4 * unit, at.y - 4 * unit},
            tip{x, at.y + 2 * unit};
        ImDrawList& list = *ImGui::GetWindowDrawList();
        list.AddTriangleFilled(left, right, tip, IM_COL32(255, 170, 40, 255));
        // Orange is hardly to be told from a light window.
        list.AddTriangle(left, right, tip, ImGui::GetColorU32(ImGuiCol_Text), unit);
    }
    ImGui::End();
}

void Viewer::drawStatus() {
    messagesDrawn_ = visibleMessages();
    if (panes_.empty()) return;
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    const auto unit = static_cast<float>(window_.unit());
    const auto right =
        static_cast<float>((panes_.back().x + panes_.back().width) / window_.scale());
    const auto [backing, plain, good, bad] = statusColours(settings_.theme);
    float y = 8 * unit;
    // A line, or more where it is longer than the picture is wide, on something to read it from.
    auto text = [&](ImU32 colour, const std::string& words) {
        const float wrap = std::max(right - 32 * unit, 60 * unit);
        const ImVec2 size = ImGui::CalcTextSize(words.c_str(), nullptr, false, wrap);
        list.AddRectFilled({8 * unit, y}, {20 * unit + size.x, y + size.y + 6 * unit}, backing,
                           4 * unit);
        list.AddText(ImGui::GetFont(), ImGui::GetFontSize(), {14 * unit, y + 3 * unit}, colour,
                     words.c_str(), nullptr, wrap);
        y += size.y + 9 * unit;
    };
    std::string figures = fmt::format("pose {:.0f} ms, picture {:.0f} ms, window {:.0f} ms",
                                      times_.pose, times_.draw, times_.show);
    if (interacting() && times_.fps > 0)
        figures = fmt::format("{:.0f} fps: ", times_.fps) + figures;
    if (times_.paint > 0) figures += fmt::format(", texture {:.0f} ms", times_.paint);
    if (painter_->busy()) figures += ", painting the texture ...";
    if (settings_.figures) text(plain, figures);
    if (film_)
        text(plain, fmt::format("film: {:.0f} %, {}{}", 100. * filmProgress(),
                                film_->out().filename().string(),
                                leaveAfterFilm_ ? "; then the window closes" : ""));
    if (making_)
        text(plain, fmt::format("avatar of {}: {}", making_->clip().filename().string(),
                                making_->stops() ? "stops" : making_->brief()));
    if (export_ && window_.closed()) text(bad, "the window closes once the glTF file is written");
    size_t shown = 0;
    for (auto message = messages_.rbegin(); message != messages_.rend() && shown < kMessagesShown;
         ++message)
        if (messageVisible(*message)) {
            text(message->wrong ? bad : good, message->text);
            ++shown;
        }
    if (settings_.figures && !settings_.help && pictures_ < 400) {
        const float line = ImGui::GetFontSize();
        y = static_cast<float>(panes_[0].height / window_.scale()) - line - 14 * unit;
        if (const std::string key = keys_.keyOf(Action::Help); !key.empty())
            text(plain, key + ": help");
    }
}

void Viewer::drawQuestion() {
    const std::optional<std::string> chosen = question_.draw(window_.unit());
    if (question_.appears()) framesToDraw_ = std::max(framesToDraw_, 2);
    if (chosen) answer(*chosen);
}

}  // namespace doppel
