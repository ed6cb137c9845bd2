// glTF files, which take many turns of the window, and what is written into them.
#include <GLFW/glfw3.h>

#include <algorithm>
#include <future>

#include "engine/error.h"
#include "trainer/avatar/export.h"
#include "viewer/job.h"
#include "viewer/viewer.h"

namespace doppel {
namespace fs = std::filesystem;

// What plays, as it is seen: the motion with what was edited, the keys, or the pose alone.
Motion Viewer::shownMotion() const {
    Motion motion;
    motion.name = this->motion() ? this->motion()->name : hasKeys() ? "keyframes" : "pose";
    motion.fps = fps();
    motion.betas = editor_->betas();
    for (int64_t i = 0; i < frameCount(); ++i) {
        Pose pose = editor_->poseAt(static_cast<double>(i));
        motion.theta.push_back(thetaOf(pose));
        motion.trans.push_back(transOf(pose));
    }
    if (this->motion() && !this->motion()->cameras.empty()) {
        motion.cameras = this->motion()->cameras;
        return motion;
    }
    // Poses in the viewer are in camera space; any camera says so.
    motion.cameras.assign(motion.theta.size(), orbit_.camera(512, 512));
    return motion;
}

void Viewer::startExport(const fs::path& out) {
    if (export_) throwInput("an export is being written already");
    if (!avatar_->textured) throwInput("the avatar has no texture yet");
    if (out.extension() != ".glb")
        throwInput("expected a name that ends in .glb, found \"{}\"", out.string());
    export_ = std::make_unique<ExportJob>();
    export_->out = out;
    Avatar avatar = avatar_->avatar;
    avatar.betas = editor_->betas();
    if (settings_.mesh == MeshKind::Body) avatar.meshNet.clear();
    TextureKind kind =
        settings_.texture == TextureKind::Coarse ? TextureKind::Coarse : TextureKind::Best;
    export_->done = std::async(
        std::launch::async,
        [device = options_.device, avatar = std::move(avatar), out, motion = shownMotion(), kind] {
            Device exporting(device);
            exportAvatar(exporting, avatar, out, &motion, {.texture = kind});
            glfwPostEmptyEvent();
        });
}

void Viewer::advanceJobs() {
    if (export_ &&
        export_->done.wait_for(std::chrono::milliseconds(0)) == std::future_status::ready) {
        std::unique_ptr<ExportJob> job = std::move(export_);
        try {
            job->done.get();
        } catch (...) {
            window_.keepOpen();  // whoever closed it shall hear of it
            throw;
        }
        say(fmt::format("glTF in {}", job->out.string()));
    }
    if (mixSave_ &&
        mixSave_->done.wait_for(std::chrono::milliseconds(0)) == std::future_status::ready) {
        const std::unique_ptr<ExportJob> job = std::move(mixSave_);
        try {
            job->done.get();
        } catch (...) {
            mixSaved_ = false;
            window_.keepOpen();
            throw;
        }
        say(fmt::format("avatar in {}", job->out.string()));
    }
    if (film_) advanceFilm();
}

}  // namespace doppel
