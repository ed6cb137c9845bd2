// The panel on the right, the timeline below, the figures in the corner.
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/error.h"
#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr auto kPanelWidth = float{Viewer::kPanelWidth},
               kTimelineHeight = float{Viewer::kTimelineHeight};
constexpr double kDegrees = 180 / std::numbers::pi;

struct Choice {
    const char* name;
    int value;
};

// True where another one was chosen.
template <size_t N>
bool choose(const char* label, const Choice (&choices)[N], int& value) {
    const char* now = "";
    for (const Choice& choice : choices)
        if (choice.value == value) now = choice.name;
    bool changed = false;
    if (ImGui::BeginCombo(label, now)) {
        for (const Choice& choice : choices)
            if (ImGui::Selectable(choice.name, choice.value == value)) {
                changed = value != choice.value;
                value = choice.value;
            }
        ImGui::EndCombo();
    }
    return changed;
}

bool slider(const char* label, double& value, double low, double high, const char* format) {
    return ImGui::SliderScalar(label, ImGuiDataType_Double, &value, &low, &high, format);
}

std::string shown(const char* snakeCase) {
    std::string name = snakeCase;
    std::ranges::replace(name, '_', ' ');
    return name;
}

// A slider's drag is one gesture.
void gestureOfItem(PoseEditor& editor, std::string_view name) {
    if (ImGui::IsItemActivated()) editor.beginGesture(name);
}

constexpr ImGuiWindowFlags kFixed = ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize |
                                    ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoTitleBar |
                                    ImGuiWindowFlags_NoBringToFrontOnFocus |
                                    ImGuiWindowFlags_NoSavedSettings;

}  // namespace

void Viewer::drawPanel() {
    if (!settings_.panel) return;
    ImVec2 size = ImGui::GetIO().DisplaySize;
    ImGui::SetNextWindowPos({size.x - kPanelWidth, 0});
    ImGui::SetNextWindowSize({kPanelWidth, size.y - kTimelineHeight});
    ImGui::Begin("panel", nullptr, kFixed);
    ImGui::PushItemWidth(170);
    if (ImGui::BeginTabBar("tabs")) {
        if (ImGui::BeginTabItem("View")) {
            drawViewTab();
            ImGui::EndTabItem();
        }
        if (ImGui::BeginTabItem("Pose")) {
            drawPoseTab();
            ImGui::EndTabItem();
        }
        if (ImGui::BeginTabItem("Shape")) {
            drawShapeTab();
            ImGui::EndTabItem();
        }
        if (ImGui::BeginTabItem("Files")) {
            drawFilesTab();
            ImGui::EndTabItem();
        }
        ImGui::EndTabBar();
    }
    ImGui::PopItemWidth();
    ImGui::End();
}

void Viewer::drawViewTab() {
    const Avatar& avatar = avatar_->avatar;
    int mesh = static_cast<int>(settings_.mesh);
    if (scene_->hasRefinedMesh()) {
        constexpr Choice kMeshes[] = {
            {"body", static_cast<int>(MeshKind::Body)},
            {"refined by the network", static_cast<int>(MeshKind::Refined)}};
        choose("mesh", kMeshes, mesh);
        settings_.mesh = static_cast<MeshKind>(mesh);
    } else {
        ImGui::TextDisabled("mesh: body (stage mesh is not trained)");
    }
    auto paint = static_cast<int>(settings_.paint);
    constexpr Choice kPaints[] = {
        {"texture", kPaintTexture},    {"none (clay)", kPaintClay},
        {"normals", kPaintNormals},    {"visibility map", kPaintVisibility},
        {"UV checker", kPaintChecker}, {"part labels", kPaintParts},
        {"clamp bounds", kPaintClamps}};
    choose("surface", kPaints, paint);
    settings_.paint = static_cast<uint32_t>(paint);
    auto texture = static_cast<int>(settings_.texture);
    constexpr int kCoarse = static_cast<int>(TextureKind::Coarse),
                  kRefined = static_cast<int>(TextureKind::Refined),
                  kBaked = static_cast<int>(TextureKind::Baked);
    if (avatar.refineNet.empty()) {
        ImGui::TextDisabled(avatar_->textured ? "texture: coarse (stage refine is not trained)"
                                              : "texture: none yet");
    } else if (avatar.bakedTexture.empty()) {
        constexpr Choice kTextures[] = {{"coarse", kCoarse}, {"refined for the view", kRefined}};
        choose("texture", kTextures, texture);
    } else {
        constexpr Choice kTextures[] = {
            {"coarse", kCoarse}, {"refined for the view", kRefined}, {"refined, baked", kBaked}};
        choose("texture", kTextures, texture);
    }
    settings_.texture = static_cast<TextureKind>(texture);
    auto split = static_cast<int>(settings_.split);
    constexpr Choice kSplits[] = {{"off", static_cast<int>(Split::None)},
                                  {"body | refined mesh", static_cast<int>(Split::Meshes)},
                                  {"coarse | refined texture", static_cast<int>(Split::Textures)}};
    choose("side by side", kSplits, split);
    settings_.split = static_cast<Split>(split);
    ImGui::Checkbox("wireframe", &settings_.wireframe);
    ImGui::SameLine(150);
    ImGui::Checkbox("atlas in the corner", &settings_.atlas);
    ImGui::Checkbox("joints", &settings_.joints);
    ImGui::SameLine(150);
    ImGui::Checkbox("figures", &settings_.figures);

    ImGui::Separator();
    ImGui::Checkbox("light", &settings_.lit);
    ImGui::SameLine();
    ImGui::TextDisabled(settings_.lit ? "one, from afar" : "flat, as trained");
    if (settings_.lit) {
        slider("from the side", settings_.lightYaw, -std::numbers::pi, std::numbers::pi, "%.2f");
        slider("from above", settings_.lightPitch, -1.57, 1.57, "%.2f");
        slider("ambient", settings_.ambient, 0, 1, "%.2f");
    }

    ImGui::Separator();
    auto backdrop = static_cast<int>(settings_.backdrop);
    constexpr Choice kBackdrops[] = {{"colour", static_cast<int>(Backdrop::Colour)},
                                     {"picture (drop one)", static_cast<int>(Backdrop::Picture)},
                                     {"the capture's frames", static_cast<int>(Backdrop::Capture)}};
    choose("background", kBackdrops, backdrop);
    settings_.backdrop = static_cast<Backdrop>(backdrop);
    if (settings_.backdrop == Backdrop::Colour)
        ImGui::ColorEdit3("colour", settings_.colour.data(), ImGuiColorEditFlags_NoInputs);
    if (settings_.backdrop == Backdrop::Capture && (!capture_ || !settings_.captureCamera))
        ImGui::TextDisabled(capture_ ? "seen with the capture's camera only"
                                     : "no capture is loaded");

    ImGui::Separator();
    if (ImGui::Button("frame all")) frameAll();
    ImGui::SameLine();
    if (ImGui::Button("front")) lookFrom(0, 0);
    ImGui::SameLine();
    if (ImGui::Button("side")) lookFrom(std::numbers::pi / 2, 0);
    ImGui::SameLine();
    if (ImGui::Button("top")) lookFrom(orbit_.yaw, 1.55);
    ImGui::Checkbox("orthographic", &orbit_.orthographic);
    if (motion_ && !motion_->cameras.empty()) {
        ImGui::SameLine(150);
        ImGui::Checkbox("the capture's camera", &settings_.captureCamera);
    }
    double degrees = orbit_.fieldOfView * kDegrees;
    if (!settings_.captureCamera && slider("field of view", degrees, 5, 100, "%.0f deg"))
        orbit_.fieldOfView = degrees / kDegrees;
}

void Viewer::drawPoseTab() {
    PoseEditor& editor = *editor_;
    auto button = [](const char* label, bool enabled) {
        if (!enabled) ImGui::BeginDisabled();
        bool pressed = ImGui::Button(label);
        if (!enabled) ImGui::EndDisabled();
        return pressed && enabled;
    };
    if (button("undo", editor.canUndo())) editor.undo();
    ImGui::SameLine();
    if (button("redo", editor.canRedo())) editor.redo();
    ImGui::SameLine();
    if (ImGui::Button("mirror")) editor.mirror();
    ImGui::SameLine();
    if (ImGui::Button("reset all")) editor.resetPose();
    if (ImGui::Button("copy")) {
        window_.setClipboard(editor.copy());
        say("pose copied");
    }
    ImGui::SameLine();
    if (ImGui::Button("paste")) attempt([&] { editor.paste(window_.clipboard()); });
    ImGui::SameLine();
    ImGui::Checkbox("joint limits", &settings_.limits);

    ImGui::Separator();
    ImGui::TextDisabled("degrees about the joint's own axes");
    ImGui::BeginChild("joints");
    for (size_t j = 0; j < joint::kCount; ++j) {
        ImGui::PushID(static_cast<int>(j));
        bool open = selected_ == j;
        std::string name = shown(jointName(j)) + (pins_.contains(j) ? "  [pinned]" : "");
        if (ImGui::Selectable(name.c_str(), open))
            selected_ = open ? std::nullopt : std::optional<size_t>(j);
        if (open) {
            Pose pose = editor.pose();
            glm::dvec3 degrees = pose.rotation[j] * kDegrees;
            bool changed = false, ended = false;
            const char* labels[] = {"x", "y", "z"};
            for (int axis = 0; axis < 3; ++axis) {
                changed |= slider(labels[axis], degrees[axis], -180, 180, "%.1f");
                gestureOfItem(editor, jointName(j));
                ended |= ImGui::IsItemDeactivated();
            }
            if (changed) {
                Pose edited = pose;
                edited.rotation[j] = degrees / kDegrees;
                editor.setPose(settings_.limits ? clampToLimits(edited, pose) : edited);
            }
            if (ended) editor.endGesture();
            if (ImGui::Button("reset")) editor.resetJoint(j);
            ImGui::SameLine();
            bool pinned = pins_.contains(j);
            if (j != joint::kPelvis && ImGui::Checkbox("pinned", &pinned)) {
                if (pinned)
                    pins_.insert(j);
                else
                    pins_.erase(j);
            }
        }
        ImGui::PopID();
    }
    ImGui::EndChild();
}

void Viewer::drawShapeTab() {
    PoseEditor& editor = *editor_;
    ImGui::TextWrapped(
        "Shape coefficients of the body, in standard deviations. The networks were "
        "trained on this person's own.");
    Betas betas = editor.betas();
    bool changed = false, ended = false;
    for (size_t k = 0; k < betas.size(); ++k) {
        changed |= ImGui::SliderFloat(fmt::format("beta {}", k).c_str(), &betas[k], -4, 4, "%.2f");
        gestureOfItem(editor, "shape");
        ended |= ImGui::IsItemDeactivated();
    }
    if (changed) editor.setBetas(betas);
    if (ended) editor.endGesture();
    if (ImGui::Button("this person's own")) editor.resetBetas();
}

void Viewer::drawFilesTab() {
    ImGui::TextWrapped(
        "Drop a capture, a poses.npz, a .bvh, a pose's .json or a picture on the "
        "window, or name it:");
    ImGui::PushItemWidth(-1);
    ImGui::InputText("##path", pathText_.data(), pathText_.size());
    ImGui::PopItemWidth();
    if (ImGui::Button("open") && pathText_[0] != 0)
        attempt([&] { openDropped(std::filesystem::path(pathText_.data())); });
    if (motion_) {
        ImGui::SameLine();
        if (ImGui::Button("close motion")) {
            motion_.reset();
            capture_.reset();
            captureFrames_.reset();
            settings_.captureCamera = false;
            timeline_ = 0;
            playing_ = false;
        }
        ImGui::TextWrapped("motion: %s, %d frames at %.4g fps", motion_->name.c_str(),
                           static_cast<int>(motion_->size()), motion_->fps);
    }
    ImGui::Separator();
    ImGui::TextWrapped(
        "Written into the folder that the viewer was started in; nothing that is "
        "there is overwritten.");
    bool free = !working();
    if (!free) ImGui::BeginDisabled();
    if (ImGui::Button("film, .mp4")) attempt([&] { startFilm(freeName("doppel", ".mp4"), 0); });
    ImGui::SameLine();
    if (ImGui::Button("pictures, PNG"))
        attempt([&] { startFilm(freeName("doppel-frames", ""), 0); });
    if (ImGui::Button("glTF, .glb")) attempt([&] { startExport(freeName("doppel", ".glb")); });
    ImGui::SameLine();
    if (ImGui::Button("poses, .npz")) attempt([&] { savePoses(freeName("poses", ".npz")); });
    ImGui::SameLine();
    if (ImGui::Button("picture")) attempt([&] { saveScreenshot(freeName("doppel", ".png")); });
    if (!free) ImGui::EndDisabled();
    if (film_) {
        ImGui::ProgressBar(filmProgress(), {-1, 0});
        if (ImGui::Button("give up")) cancelFilm();
    }
    if (export_) ImGui::TextDisabled("writing glTF ...");
}

void Viewer::drawTimeline() {
    ImVec2 size = ImGui::GetIO().DisplaySize;
    ImGui::SetNextWindowPos({0, size.y - kTimelineHeight});
    ImGui::SetNextWindowSize({size.x, kTimelineHeight});
    ImGui::Begin("timeline", nullptr, kFixed | ImGuiWindowFlags_NoScrollbar);
    int64_t count = frameCount();
    if (ImGui::Button(playing_ ? "pause" : " play ")) playing_ = !playing_ && count > 1;
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
    if (count <= 1)
        ImGui::TextDisabled("no motion: open one, or set keys at different frames");
    else
        ImGui::TextDisabled("%s", motion_ ? motion_->name.c_str() : "keyframes");

    // Without a motion there is room to set keys in.
    int last = static_cast<int>(motion_ ? count - 1 : std::max<int64_t>(count - 1, 120));
    int frame = static_cast<int>(now);
    ImGui::PushItemWidth(-1);
    ImVec2 at = ImGui::GetCursorScreenPos();
    float width = ImGui::GetContentRegionAvail().x;
    if (ImGui::SliderInt("##frame", &frame, 0, std::max(last, 1), "frame %d")) {
        playing_ = false;
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
    messageDrawn_ = messageVisible();
    if (messageDrawn_)
        text(12, 58, messageIsWrong_ ? IM_COL32(255, 120, 110, 255) : IM_COL32(160, 230, 160, 255),
             message_);
    if (settings_.figures && !settings_.help && pictures_ < 400 && !panes_.empty())
        text(12, ImGui::GetIO().DisplaySize.y - kTimelineHeight - 22, IM_COL32(200, 205, 215, 160),
             "H: help");
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
        {"K", "keyframe here"},
        {"Ctrl + S", "save poses.npz"},
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
