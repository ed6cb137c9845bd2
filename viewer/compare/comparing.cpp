// Two avatars in one window.
#include <algorithm>

#include "viewer/viewer.h"

namespace doppel {

namespace {

// The last names of a path, so many of them.
std::string lastNames(const std::filesystem::path& path, int count) {
    std::filesystem::path rest = std::filesystem::absolute(path).lexically_normal(), names;
    if (!rest.has_filename()) rest = rest.parent_path();
    for (; count > 0 && rest.has_relative_path(); --count, rest = rest.parent_path())
        names = names.empty() ? rest.filename() : rest.filename() / names;
    return names.string();
}

}  // namespace

void Viewer::compareWith(const std::filesystem::path& folder) {
    compared_ = std::make_unique<Compared>(device_, folder);
    ++comparedVersion_;
    settings_.split = Split::Avatars;
    settings_.divided = true;  // what differs lies in the same place
    opened(folder);
    say("compared with " + splitNames().second);
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
        case Split::Avatars:  // `doppel avatar` calls all avatars "avatar"
            for (int count = 1; count < 3; ++count) {
                const std::string left = lastNames(source_.folder(), count),
                                  right = lastNames(compared_->folder(), count);
                if (left != right || count == 2) return {left, right};
            }
            break;
    }
    return {};
}

void Viewer::followCompared() {
    if (!compared_ || !compared_->reload()) return;
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
