// Films and glTF files, which take many turns of the window.
#include <GLFW/glfw3.h>

#include <cmath>
#include <future>

#include "engine/error.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/films/picture_sequence.h"
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

void Viewer::startFilm(const fs::path& out, int size) {
    if (film_) throwInput("a film is being drawn already");
    if (panes_.empty()) throwInput("there is no picture to film");
    Pane pane = panes_.back();
    if (size > 0) {
        double scale = static_cast<double>(size) / std::max(pane.width, pane.height);
        pane.width = std::max(16, static_cast<int>(pane.width * scale));
        pane.height = std::max(16, static_cast<int>(pane.height * scale));
    }
    film_ = std::unique_ptr<FilmJob>(new FilmJob{.out = out,
                                                 .pictures = {out, pane.width, pane.height, fps()},
                                                 .pane = pane,
                                                 .count = frameCount(),
                                                 .timelineBefore = timeline_});
    playing_ = false;
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
    if (export_ && export_->done.wait_for(std::chrono::milliseconds(film_ ? 0 : 5)) ==
                       std::future_status::ready) {
        std::unique_ptr<ExportJob> job = std::move(export_);
        try {
            job->done.get();
        } catch (...) {
            window_.keepOpen();  // whoever closed it shall hear of it
            throw;
        }
        say(fmt::format("glTF in {}", job->out.string()));
    }
    if (film_) advanceFilm();
}

void Viewer::cancelFilm() {
    if (!film_) return;
    endFilm();
    say("the film was given up; nothing of it is left");
}

// All as it was before the film; what is not finished leaves no file.
void Viewer::endFilm() {
    timeline_ = film_->timelineBefore;
    film_.reset();
    shown_.reset();
    showTime();
}

float Viewer::filmProgress() const {
    return film_ ? static_cast<float>(film_->next) / static_cast<float>(film_->count) : 0;
}

void Viewer::advanceFilm() {
    try {
        FilmJob& film = *film_;
        timeline_ = static_cast<double>(film.next);
        if (frameCount() > 1) showTime();
        Pose pose = editor_->pose();
        scene_->setPose(thetaOf(pose), transOf(pose), editor_->betas());
        if (paintsViews(film.pane.texture) && settings_.paint == kPaintTexture) {
            if (!film.asked) {
                if (painter_->busy()) return;
                painter_->ask(film.pane.texture, scene_->vertices(film.pane.mesh, view()),
                              ++viewVersion_);
                film.asked = true;
            }
            if (painted_[film.pane.texture] != viewVersion_) return;  // not yet
        }
        film.asked = false;
        useTexture(film.pane.texture);
        std::span<const uint32_t> background = behind(film.pane);
        ShadeOptions shade = shadeOptions(film.pane);
        shade.blueFirst = false;
        std::vector<uint32_t> pixels =
            scene_->draw(film.pane.mesh, cameraOf(film.pane), view(), shade, background, 2);
        Image image(film.pane.width, film.pane.height, 3);
        for (size_t i = 0; i < pixels.size(); ++i)
            for (size_t c = 0; c < 3; ++c)
                image.data[3 * i + c] = static_cast<uint8_t>(pixels[i] >> 8 * c);
        film.pictures.add(image);
        if (++film.next < film.count) return;
        film.pictures.finish();
        const std::string out = film.out.string();
        endFilm();
        say(fmt::format("film in {}", out));
    } catch (...) {
        if (film_) endFilm();
        throw;
    }
}

}  // namespace doppel
