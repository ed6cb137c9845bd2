// Two avatars in one window.
#include <algorithm>

#include "viewer/viewer.h"

namespace doppel {

void Viewer::compareWith(const std::filesystem::path& folder) {
    compared_ = std::make_unique<Compared>(device_, folder);
    ++comparedVersion_;
    settings_.split = Split::Avatars;
    settings_.divided = true;  // what differs lies in the same place
    opened(folder);
    say("compared with " + compared_->name());
}

void Viewer::chooseCompared() {
    askForFile(FileDialog::Asks::Folder, "Compare with the avatar in",
               [this](const std::filesystem::path& path) { compareWith(path); });
}

// The one that is edited is the left one.
Scene& Viewer::sceneOf(const Pane& pane) { return pane.other ? compared_->scene() : *scene_; }

void Viewer::nextSplit() {
    switch (settings_.split) {
        case Split::None:
            settings_.split = Split::Meshes;
            break;
        case Split::Meshes:
            settings_.split = Split::Textures;
            break;
        case Split::Textures:
            settings_.split = compared_ ? Split::Avatars : Split::None;
            break;
        case Split::Avatars:
            settings_.split = Split::None;
            break;
    }
}

std::pair<std::string, std::string> Viewer::splitNames() const {
    switch (settings_.split) {
        case Split::None:
            break;
        case Split::Meshes:
            return {"body", "refined mesh"};
        case Split::Textures:
            return {"coarse texture", "refined texture"};
        case Split::Avatars: {
            const auto folder = std::filesystem::absolute(source_.folder()).lexically_normal();
            return {(folder.has_filename() ? folder : folder.parent_path()).filename().string(),
                    compared_->name()};
        }
    }
    return {};
}

void Viewer::followCompared() {
    if (film_ || !compared_ || !compared_->reload()) return;
    ++comparedVersion_;
    say("what is compared with has changed on disk");
}

// Of the line between two parts of one picture; window coordinates.
std::optional<double> Viewer::dividerAt() const {
    if (!settings_.divided || panes_.size() != 2) return std::nullopt;
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
