// Several avatars in one window.
#include <algorithm>
#include <cmath>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

void Viewer::compareWith(const std::filesystem::path& folder) {
    others_.add(folder);
    if (settings_.split != Split::Together) settings_.split = Split::Avatars;
    settings_.divided = others_.size() == 1;  // what differs lies in the same place
    opened(folder);
    say("compared with " + personNames().back());
}

void Viewer::chooseCompared() {
    askForFile(FileDialog::Asks::Folder, "Compare with the avatar in",
               [this](const std::filesystem::path& path) { compareWith(path); });
}

// The one that is edited is the left one.
Scene& Viewer::sceneOf(const Pane& pane) {
    return pane.other > 0 ? others_[static_cast<size_t>(pane.other) - 1].scene() : *scene_;
}

void Viewer::nextSplit() {
    constexpr Split kNext[] = {Split::Meshes,  Split::Textures, Split::Source,
                               Split::Avatars, Split::Together, Split::None};
    settings_.split = kNext[static_cast<size_t>(settings_.split)];
    if (settings_.split == Split::Source && !hasSource()) settings_.split = Split::Avatars;
    if (settings_.split == Split::Avatars && others_.empty()) settings_.split = Split::None;
}

// Of all avatars that there are, the edited one's first.
std::vector<std::string> Viewer::personNames() const {
    std::vector<std::filesystem::path> folders{source_.folder()};
    for (size_t i = 0; i < others_.size(); ++i) folders.push_back(others_[i].folder());
    return namesOf(folders);
}

// Of what is seen in each pane; empty where there is but one.
std::vector<std::string> Viewer::paneNames() const {
    switch (settings_.split) {
        case Split::Meshes:
            return {"body", "refined mesh"};
        case Split::Textures:
            return {"coarse texture", "refined texture"};
        case Split::Source:
            return {capture() ? "the frame" : "the motion's own body", personNames()[0]};
        case Split::Avatars:
            return personNames();
        case Split::None:
        case Split::Together:
            break;
    }
    return {};
}

void Viewer::followCompared() {
    if (others_.reload()) say("what is compared with has changed on disk");
}

// Those who stand in a row; nothing where each has a picture of their own.
std::optional<Company::Row> Viewer::row() {
    if (settings_.split != Split::Together) return {};
    Company::Row row{.apart = settings_.apart};
    if (const std::optional<RigidMotion> floor = worldToFloor())
        row.up = glm::transpose(floor->rotation) * glm::dvec3(0, 1, 0);
    return row;
}

// The others of a row, each behind what is nearer, over pixels [H,W] of R, G, B, A; depths: as
// Scene::draw() takes them, of the same size. refinement: of Scene::refine(), nothing for one
// sample.
void Viewer::drawOthers(const Pane& pane, std::optional<int> refinement,
                        std::vector<uint32_t>& pixels, std::vector<float>& depths) {
    ShadeOptions shade = shadeOptions(pane);
    shade.inset = 0;
    constexpr int kPlace = 0;
    for (size_t i = 0; i < others_.size(); ++i) {
        const MeshKind mesh = others_[i].mesh(pane.mesh);
        Scene& scene = others_[i].scene();
        pixels = refinement ? scene.refine(mesh, cameraOf(pane), view(), shade, pixels, kPlace,
                                           *refinement, {}, &depths)
                            : scene.draw(mesh, cameraOf(pane), view(), shade, pixels,
                                         movingSamples_.now(), {}, &depths);
    }
}

void Viewer::drawCompanyControls() {
    if (settings_.split == Split::Together)
        slider("apart", "How far they stand from each other, metres.", settings_.apart, 0, 2,
               "%.2f m");
    const std::vector<std::string> names = personNames();
    std::optional<size_t> leaves;
    for (size_t i = 0; i < others_.size(); ++i) {
        ImGui::PushID(static_cast<int>(i));
        if (button("without", "Takes this avatar away again.")) leaves = i;
        ImGui::SameLine();
        hint(names[i + 1]);
        ImGui::PopID();
    }
    if (leaves) others_.remove(*leaves);
    if (button("another...", "Chooses an avatar to see with this one.",
               others_.size() < Company::kMost))
        attempt([&] { chooseCompared(); });
}

// Who is who in a row: names above their heads.
void Viewer::drawPersonNames(const Pane& pane) {
    const std::optional<Company::Row> row = this->row();
    if (!row) return;
    constexpr double kAbove = .28;  // metres from the head's joint
    const std::vector<std::string> names = personNames();
    for (size_t i = 0; i < names.size(); ++i) {
        glm::dvec3 place = posed().position[joint::kHead] + kAbove * row->up;
        if (i > 0) place += others_.offset(i - 1, editor_->betas(), avatar_->avatar, *row);
        const glm::dvec3 at = onScreen(place, pane);
        if (at.z <= 0) continue;
        const float half = ImGui::CalcTextSize(names[i].c_str()).x / 2;
        drawLabel({static_cast<float>(at.x) - half, static_cast<float>(at.y)}, names[i]);
    }
}

// Of the line between two parts of one picture; window coordinates.
std::optional<double> Viewer::dividerAt() const {
    if (panes_.size() != 2 || panes_[0].width == panes_[0].viewWidth) return std::nullopt;
    return panes_[1].x / window_.scale();
}

bool Viewer::onDivider(double x) const {
    const auto line = dividerAt();
    return line && std::abs(x - *line) < kDividerPick * window_.unit();
}

void Viewer::dragDivider() {
    if (panes_.empty()) return;
    const double width = panes_[0].viewWidth / window_.scale();
    settings_.divider = static_cast<float>(std::clamp(mouse_.x / width, 0.0, 1.0));
}

}  // namespace doppel
