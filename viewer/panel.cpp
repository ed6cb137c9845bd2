// The panel on the right.
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/error.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

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

std::string shown(const char* snakeCase) {
    std::string name = snakeCase;
    std::ranges::replace(name, '_', ' ');
    return name;
}

// A slider's drag is one gesture.
bool beginsGesture(PoseEditor& editor, std::string_view name) {
    if (ImGui::IsItemActivated()) editor.beginGesture(name);
    return ImGui::IsItemActivated();
}

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
    if (settings_.backdrop == Backdrop::Capture && (!capture() || !settings_.captureCamera))
        ImGui::TextDisabled(capture() ? "seen with the capture's camera only"
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
    if (motion() && !motion()->cameras.empty()) {
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
    if (button("undo", editor.canUndo())) undo();
    ImGui::SameLine();
    if (button("redo", editor.canRedo())) redo();
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
    ImGui::Checkbox("balance over pinned feet", &settings_.balance);

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
                if (beginsGesture(editor, jointName(j))) play(false);
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
        beginsGesture(editor, "shape");
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
        attempt([&] { openFile(std::filesystem::path(pathText_.data())); });
    if (motion()) {
        ImGui::SameLine();
        if (ImGui::Button("close motion"))
            attempt([&] {
                afterSaving("Closing the motion puts away what you edited, which is not saved.",
                            [this] { closeMotion(); });
            });
    }
    if (motion()) {
        ImGui::TextWrapped("motion: %s, %d frames at %.4g fps", motion()->name.c_str(),
                           static_cast<int>(motion()->size()), motion()->fps);
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
    if (ImGui::Button("poses, .npz")) attempt([&] { save(); });
    ImGui::SameLine();
    if (ImGui::Button("picture")) attempt([&] { saveScreenshot(freeName("doppel", ".png")); });
    if (!free) ImGui::EndDisabled();
    if (film_) {
        ImGui::ProgressBar(filmProgress(), {-1, 0});
        if (ImGui::Button("give up")) cancelFilm();
    }
    if (export_) ImGui::TextDisabled("writing glTF ...");
}

}  // namespace doppel
