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
    const fs::path folder = Making::folderOf(clip);
    std::error_code ignored;
    ask({fmt::format("An avatar of the person in {} goes into {}, which takes minutes. The window "
                     "shows it as soon as there is something to see.{}",
                     clip.filename().string(), folder.string(),
                     fs::exists(folder, ignored) ? " What was begun there goes on." : ""),
         {{"Make it",
           [this, clip] {
               const fs::path program =
                   options_.program.empty() ? fs::read_symlink("/proc/self/exe") : options_.program;
               making_.emplace(program, clip, options_.device.name);
               madeShown_ = false;
           },
           "Runs `doppel avatar` beside the window."},
          {"Cancel", {}, "Leaves all as it is."}}});
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
    if (*made.status() == 0)
        say(fmt::format("avatar in {}", made.avatar().string()));
    else if (made.stops())
        say(fmt::format("{}: stopped; dropped again it goes on from there",
                        made.clip().filename().string()));
    else
        throwInput("{}", made.line());
}

void Viewer::askToLeaveMaking() {
    ask({fmt::format("An avatar of {} is being made: {}.", making_->clip().filename().string(),
                     making_->brief()),
         {{"Stop it, and close",
           [this] {
               stopMaking();
               making_.reset();
               window_.close();
           },
           "What is done stays: the clip, dropped again, goes on from there."},
          {"Let it go on, and close",
           [this] {
               making_.reset();
               window_.close();
           },
           "It is finished without the window."},
          {"Cancel", {}, "The window stays open."}}});
}

}  // namespace doppel
