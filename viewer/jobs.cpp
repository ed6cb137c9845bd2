// Films and glTF files, which take many turns of the window.
#include <GLFW/glfw3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <future>

#include "engine/error.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/films/picture_sequence.h"
#include "viewer/job.h"
#include "viewer/viewer.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Straight alpha of what was drawn over black and over white, whose difference is what is not
// covered: white - black = 255 (1 - alpha), black = alpha colour.
Image withAlpha(const std::vector<uint32_t>& black, const std::vector<uint32_t>& white, int width,
                int height) {
    Image image(width, height, 4);
    for (size_t i = 0; i < black.size(); ++i) {
        int uncovered = 0;
        std::array<int, 3> colour{};
        for (size_t c = 0; c < 3; ++c) {
            colour[c] = int(black[i] >> 8 * c & 255);
            uncovered += int(white[i] >> 8 * c & 255) - colour[c];
        }
        const int alpha = std::clamp(255 - (uncovered + 1) / 3, 0, 255);
        for (size_t c = 0; c < 3; ++c)
            image.data[4 * i + c] =
                alpha > 0 ? uint8_t(std::min(255, (colour[c] * 255 + alpha / 2) / alpha)) : 0;
        image.data[4 * i + 3] = uint8_t(alpha);
    }
    return image;
}

}  // namespace

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

void Viewer::startFilm(const fs::path& out, const FilmSettings& settings) {
    if (film_) throwInput("a film is being drawn already");
    if (panes_.empty()) throwInput("there is no picture to film");
    Pane pane = panes_.back().other ? panes_.front() : panes_.back();
    pane.x = pane.viewX;  // of a part of a view the whole
    pane.width = pane.viewWidth;
    if (settings.size > 0) {
        double scale = static_cast<double>(settings.size) / std::max(pane.width, pane.height);
        pane.width = pane.viewWidth = std::max(16, static_cast<int>(pane.width * scale));
        pane.height = std::max(16, static_cast<int>(pane.height * scale));
    }
    const int64_t end = frameCount() - 1, first = std::clamp<int64_t>(settings.first, 0, end),
                  last = settings.last < 0 ? end : std::clamp<int64_t>(settings.last, first, end);
    const VideoOptions video{.alpha = settings.clear};
    film_ = std::unique_ptr<FilmJob>(
        new FilmJob{.out = out,
                    .pictures = {out, pane.width, pane.height, fps(), video},
                    .pane = pane,
                    .clear = settings.clear,
                    .first = first,
                    .count = last - first + 1,
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
        timeline_ = static_cast<double>(film.first + film.next);
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
        ShadeOptions shade = shadeOptions(film.pane);
        shade.blueFirst = false;
        const auto drawn = [&](std::span<const uint32_t> background) {
            return scene_->draw(film.pane.mesh, cameraOf(film.pane), view(), shade, background, 2);
        };
        Image image;
        if (film.clear) {
            const size_t pixels = size_t(film.pane.width) * size_t(film.pane.height);
            image = withAlpha(drawn(std::vector<uint32_t>(pixels, 0xff000000)),
                              drawn(std::vector<uint32_t>(pixels, 0xffffffff)), film.pane.width,
                              film.pane.height);
        } else {
            image = Image(film.pane.width, film.pane.height, 3);
            const std::vector<uint32_t> pixels = drawn(behind(film.pane));
            for (size_t i = 0; i < pixels.size(); ++i)
                for (size_t c = 0; c < 3; ++c)
                    image.data[3 * i + c] = static_cast<uint8_t>(pixels[i] >> 8 * c);
        }
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
