#include "viewer/viewer.h"

#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/picture_sequence.h"
#include "trainer/avatar/rendering.h"
#include "trainer/data/frame_selection.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr double kSettleSeconds = 0.15;  // without input, before the picture becomes finer

double milliseconds(std::chrono::steady_clock::duration passed) {
    return std::chrono::duration<double, std::milli>(passed).count();
}

}  // namespace

// A glTF file being written in the background.
struct Viewer::ExportJob {
    std::future<void> done;
    fs::path out;
};

// A film being drawn, one frame per turn of the window.
struct Viewer::FilmJob {
    fs::path out;
    PictureSequence pictures;
    Pane pane;
    int64_t next = 0, count = 0;
    double timelineBefore = 0;
    bool asked = false;  // for the texture of the next frame
};

Viewer::Viewer(const ViewerOptions& options)
    : options_(options),
      source_(options.avatar),
      avatar_(source_.load()),  // before a window opens for one that is not there
      window_({"Doppel", options.width, options.height, {}}),
      device_(options.device) {
    useAvatar(avatar_);
    settings_.texture = bestTexture();
    if (!avatar_->textured) settings_.paint = kPaintClay;

    Shot rest = restShot(device_, avatar_->avatar, 512);
    editor_ = std::make_unique<PoseEditor>(poseOf(rest.theta, rest.trans), avatar_->avatar.betas);
    if (!options.motion.empty()) loadMotion(options.motion, options.frames);
    if (!options.pose.empty()) pastePose(options.pose);
    layOut();
    frameAll();
    lastTouched_ = lastFrame_ = lastTick_ = Clock::now();
}

Viewer::~Viewer() = default;

void Viewer::useAvatar(std::shared_ptr<LoadedAvatar> avatar) {
    painter_.reset();
    scene_.reset();
    avatar_ = std::move(avatar);
    const Avatar& now = avatar_->avatar;
    scene_ = std::make_unique<Scene>(device_, now);
    painter_ = std::make_unique<Painter>(now, options_.device, [] { glfwPostEmptyEvent(); });
    // Until the networks have painted the view: what comes closest.
    const std::vector<float>& baked = now.bakedTexture.empty() ? now.texture : now.bakedTexture;
    textures_ = {{TextureKind::Coarse, now.texture},
                 {TextureKind::Refined, baked},
                 {TextureKind::Baked, baked}};
    painted_.clear();
    skeletonBetas_.reset();
    ++textureVersion_;
    ++viewVersion_;
    window_.setTitle(fmt::format("{}{} - Doppel", source_.folder().filename().string(),
                                 avatar_->training ? " (in training)" : ""));
}

void Viewer::reloadIfChanged() {
    if (film_) return;  // of one person from start to end
    std::shared_ptr<LoadedAvatar> now = source_.changed();
    if (!now) return;
    bool wasTextured = avatar_->textured, hadBest = settings_.texture == bestTexture();
    bool hadOwnShape = editor_->betas() == avatar_->avatar.betas;
    useAvatar(std::move(now));
    if (hadOwnShape && editor_->betas() != avatar_->avatar.betas)
        editor_->setBetas(avatar_->avatar.betas);
    if (!wasTextured && avatar_->textured && settings_.paint == kPaintClay)
        settings_.paint = kPaintTexture;
    if (hadBest) settings_.texture = bestTexture();
    say(avatar_->training ? "the training's present state" : "the avatar has changed on disk");
}

TextureKind Viewer::bestTexture() const {
    return avatar_->avatar.refineNet.empty() ? TextureKind::Coarse : TextureKind::Refined;
}

// Whether networks paint this texture anew for each view.
bool Viewer::paintsViews(TextureKind kind) const {
    const Avatar& avatar = avatar_->avatar;
    if (kind == TextureKind::Refined) return !avatar.refineNet.empty();
    return kind == TextureKind::Coarse && !avatar.textureNet.empty() &&
           !avatar.preset.texture.constantInput;
}

void Viewer::say(std::string text, bool wrong) {
    message_ = std::move(text);
    messageIsWrong_ = wrong;
    messageSince_ = Clock::now();
    framesToDraw_ = 3;
}

// ---- one turn -----------------------------------------------------------------------------------

bool Viewer::interacting() const {
    return drag_ != Drag::None || playing_ ||
           Clock::now() - lastTouched_ < std::chrono::duration<double>(kSettleSeconds);
}

bool Viewer::settled() const {
    bool pictured =
        panes_.empty() || (shown_ && *shown_ == wanted() && refinements_ == kRefinements);
    return pictured && !interacting() && !painter_->busy() && framesToDraw_ == 0 && !working();
}

bool Viewer::messageVisible() const {
    double age = std::chrono::duration<double>(Clock::now() - messageSince_).count();
    return !message_.empty() && age < (messageIsWrong_ ? 15 : 5);
}

bool Viewer::frame() {
    if (window_.closed()) return false;
    if (messageDrawn_ != messageVisible()) framesToDraw_ = std::max(framesToDraw_, 1);
    bool rests = settled();
    // What comes from threads wakes the window.
    double wait = rests || painter_->busy() ? 0.25 : interacting() && !playing_ ? 0.02 : 0;
    if (refines()) wait = 0;
    if (framesToDraw_ > 0 || playing_ || working()) wait = 0;
    if (!drawable_) wait = working() ? 0.01 : 0.25;
    drawable_ = window_.begin(wait);
    if (window_.closed()) return false;
    reloadIfChanged();
    advanceTimeline();
    if (working()) attempt([&] { advanceJobs(); });
    if (!drawable_) return true;
    if (window_.touched()) framesToDraw_ = 3;  // ImGui answers some events a frame later
    if (rests && settled()) return true;

    window_.beginFrame();
    attempt([&] {
        for (const fs::path& path : window_.dropped()) openDropped(path);
        handleKeys();
        layOut();
        handleMouse();
    });
    updateTextures();
    if (!film_) updatePictures();
    drawOverlays();
    drawPanel();
    drawTimeline();
    drawStatus();
    drawHelp();
    std::vector<PlacedPicture> placed;
    for (size_t i = 0; shown_ && i < pixels_.size(); ++i) {
        const Pane& pane = shown_->panes[i];
        placed.push_back({pane.x, pane.y, pane.width, pane.height, pixels_[i]});
    }
    auto drawn = Clock::now();
    window_.end(placed);
    times_.show = milliseconds(Clock::now() - drawn);
    double passed = milliseconds(Clock::now() - lastFrame_);
    if (wait == 0 && passed > 0) times_.fps += 0.2 * (1000 / passed - times_.fps);
    lastFrame_ = Clock::now();
    if (framesToDraw_ > 0) --framesToDraw_;
    return true;
}

void Viewer::run(const std::function<void()>& each) {
    try {
        do {
            if (each) each();
        } while (frame());
    } catch (const MachineError& error) {
        fs::path kept = freeName("doppel-pose", ".json");
        try {
            AtomicFile file(kept);
            file.write(editor_->copy());
            file.commit();
        } catch (const std::exception&) {
            throw error;
        }
        throwMachine("{}; the pose is kept in {}, which `doppel view --pose` takes", error.what(),
                     kept.string());
    }
}

// What goes wrong with a file is said in the window, which goes on. A device that is lost shows
// again where pictures are computed, and is not caught there.
void Viewer::attempt(const std::function<void()>& action) {
    try {
        action();
    } catch (const InputError& error) {
        say(error.what(), true);
    } catch (const MachineError& error) {
        say(error.what(), true);
    }
}

// ---- the timeline -------------------------------------------------------------------------------

bool Viewer::hasKeys() const { return !editor_->keyframes().empty(); }
double Viewer::lastKey() const { return hasKeys() ? editor_->keyframes().back().time : 0; }

int64_t Viewer::frameCount() const {
    if (motion_) return static_cast<int64_t>(motion_->size());
    return static_cast<int64_t>(std::floor(lastKey())) + 1;
}

void Viewer::advanceTimeline() {
    auto now = Clock::now();
    double passed = std::chrono::duration<double>(now - lastTick_).count();
    lastTick_ = now;
    if (playing_ && !film_) {
        auto last = static_cast<double>(frameCount() - 1);
        timeline_ += passed * speed_ * fps();
        if (timeline_ > last) {
            timeline_ = loop_ && last > 0 ? std::fmod(timeline_, last + 1) : last;
            playing_ = loop_ && last > 0;
        }
    }
    showTime();
}

// Puts the avatar where the timeline is; what was edited there before is gone, as in a player.
void Viewer::showTime() {
    double time = std::floor(timeline_);
    if (time == shownTime_ || drag_ == Drag::Joint || drag_ == Drag::Ring) return;
    shownTime_ = time;
    if (motion_) {
        auto i = static_cast<size_t>(
            std::clamp<int64_t>(static_cast<int64_t>(time), 0, frameCount() - 1));
        editor_->show(poseOf(motion_->theta[i], motion_->trans[i]));
    } else if (hasKeys()) {
        editor_->show(editor_->poseAt(time));
    }
}

double Viewer::fps() const { return motion_ && motion_->fps > 0 ? motion_->fps : 30; }

void Viewer::loadMotion(const fs::path& path, const std::string& frames) {
    Motion motion = readMotion(path);
    std::vector<size_t> chosen = selectFrames(frames, motion.size());
    motion = motion.subset(chosen);
    capture_.reset();
    captureFrames_.reset();
    if (motion.cameras.empty()) {
        // Upright, and where the avatar stands before it moves.
        motion = inCameraSpace(std::move(motion));
        Trans first = motion.trans[0], place = restShot(device_, avatar_->avatar, 512).trans;
        for (Trans& trans : motion.trans)
            for (size_t k = 0; k < 3; ++k) trans[k] += place[k] - first[k];
        settings_.captureCamera = false;
    } else if (fs::is_directory(path / "images")) {
        capture_ = readCapture(path).subset(chosen);
        captureFrames_ = std::make_unique<FrameCache>(*capture_);
    }
    motion_ = std::move(motion);
    timeline_ = 0;
    shownTime_ = -1;
    ++backdropVersion_;
    showTime();
    layOut();
    frameAll();
    say(fmt::format("{}: {} frames", motion_->name, motion_->size()));
}

void Viewer::loadPicture(const fs::path& path) {
    backdropPicture_ = readImage(path);
    settings_.backdrop = Backdrop::Picture;
    ++backdropVersion_;
}

void Viewer::pastePose(const fs::path& path) {
    std::vector<uint8_t> text = readWholeFile(path, uint64_t{1} << 20);
    try {
        editor_->paste({reinterpret_cast<const char*>(text.data()), text.size()});
    } catch (const InputError& error) {
        throwInput("{}: {}", path.string(), error.what());
    }
}

void Viewer::openDropped(const fs::path& path) {
    if (film_) throwInput("{}: a film is being drawn; Escape gives it up", path.string());
    std::string extension = path.extension().string();
    std::ranges::transform(extension, extension.begin(), [](char c) {
        return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c;
    });
    if (extension == ".json") {
        pastePose(path);
    } else if (isMotion(path)) {
        loadMotion(path);
    } else {
        loadPicture(path);
    }
}

// What plays: the motion, the keyframes, or the pose alone.
Motion Viewer::shownMotion() const {
    if (motion_) return *motion_;
    Motion motion;
    motion.name = hasKeys() ? "keyframes" : "pose";
    motion.fps = fps();
    motion.betas = editor_->betas();
    for (int64_t i = 0; i < frameCount(); ++i) {
        Pose pose = hasKeys() ? editor_->poseAt(double(i)) : editor_->pose();
        motion.theta.push_back(thetaOf(pose));
        motion.trans.push_back(transOf(pose));
    }
    // Poses in the viewer are in camera space; any camera says so.
    motion.cameras.assign(motion.theta.size(), orbit_.camera(512, 512));
    return motion;
}

// ---- files --------------------------------------------------------------------------------------

fs::path Viewer::freeName(const std::string& stem, const std::string& extension) const {
    for (int i = 1;; ++i) {
        fs::path path = fmt::format("{}-{}{}", stem, i, extension);
        if (!fs::exists(path)) return path;
    }
}

// The keyframes; without any, the motion that is loaded or the pose that is shown.
void Viewer::savePoses(const fs::path& path) {
    if (hasKeys()) {
        editor_->saveKeyframes(path, fps());
    } else {
        Motion motion = shownMotion();
        Npz arrays = posesArrays(motion.theta, motion.trans, editor_->betas());
        arrays.set("fps", Array::f32({}, std::array{static_cast<float>(motion.fps)}));
        writeNpz(path, arrays, false);
    }
    say(fmt::format("poses in {}", path.string()));
}

void Viewer::saveScreenshot(const fs::path& path) {
    if (!shown_) throwInput("there is no picture to save");
    const std::vector<Pane>& panes = shown_->panes;
    Image image(panes.back().x + panes.back().width, panes[0].height, 3);
    for (size_t i = 0; i < panes.size(); ++i) {
        const uint32_t* word = pixels_[i].data();
        for (int y = 0; y < panes[i].height; ++y)
            for (int x = 0; x < panes[i].width; ++x, ++word)
                for (int c = 0; c < 3; ++c)
                    image.pixel(panes[i].x + x, y)[window_.blueFirst() ? 2 - c : c] =
                        static_cast<uint8_t>(*word >> 8 * c);
    }
    writeImage(path, image);
    say(fmt::format("picture in {}", path.string()));
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
        job->done.get();
        say(fmt::format("glTF in {}", job->out.string()));
    }
    if (film_) advanceFilm();
}

void Viewer::cancelFilm() {
    if (!film_) return;
    timeline_ = film_->timelineBefore;
    shownTime_ = -1;
    film_.reset();
    say("the film was given up; nothing of it is left");
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
        std::span<const uint32_t> background = backgroundOf(film.pane);
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
        std::string out = film.out.string();
        timeline_ = film.timelineBefore;
        shownTime_ = -1;
        film_.reset();
        shown_.reset();
        say(fmt::format("film in {}", out));
    } catch (...) {
        film_.reset();
        throw;
    }
}

}  // namespace doppel
