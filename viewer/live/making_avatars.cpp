// An avatar of a clip that was dropped: asked for, shown as it becomes one, and told of at its end.
#include <algorithm>

#include "engine/error.h"
#include "viewer/viewer.h"

namespace doppel {
namespace fs = std::filesystem;

void Viewer::askToMake(const fs::path& clip) {
    if (making_)
        throwInput("{}: an avatar of {} is being made already; one at a time", clip.string(),
                   making_->clip().filename().string());
    ask(questionToMake(clip, [this, clip] {
        making_.emplace(options_.program, clip, options_.device.name);
        madeShown_ = false;
    }));
}

void Viewer::stopMaking() {
    if (making_) making_->stop();
    framesToDraw_ = std::max(framesToDraw_, 1);
}

void Viewer::advanceMaking() {
    if (!making_) return;
    const bool news = making_->update() || making_->status();
    if (news) framesToDraw_ = std::max(framesToDraw_, 1);
    const fs::path avatar = making_->avatar();
    if (question_ || !news) return;
    if (making_->status()) endMaking();
    // Where it was opened by hand it is shown as it is.
    if (madeShown_ || !LiveAvatar::isAvatar(avatar)) return;
    if (source_.folder() != avatar) openPerson(avatar);
    madeShown_ = true;
}

void Viewer::endMaking() {
    const Making made = std::move(*making_);
    making_.reset();
    say(made.ending());
}

void Viewer::askToLeaveMaking() {
    ask(questionToLeave(
        *making_,
        [this] {
            stopMaking();
            making_.reset();
            window_.close();
        },
        [this] {
            making_.reset();
            window_.close();
        }));
}

}  // namespace doppel
