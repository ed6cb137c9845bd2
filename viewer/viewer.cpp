#include "viewer/viewer.h"

#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/avatar/rendering.h"
#include "viewer/drawn_items.h"
#include "viewer/job.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr double kSettleSeconds = 0.15;  // without input, before the picture becomes finer
constexpr size_t kMostMessages = 200;

// That computes the pictures, and shows them, too, where it shall and can.
std::shared_ptr<Device> openDevice(DeviceOptions options, Window& window) {
    options.surfaceExtensions = window.surfaceExtensions();
    auto device = std::make_shared<Device>(std::move(options));
    window.present(presentsDirectly(device->info()) ? device : nullptr);
    return device;
}

}  // namespace

Viewer::Viewer(const ViewerOptions& options, std::unique_ptr<Window> window,
               std::optional<Making> making)
    : options_(options),
      source_(options.avatar),
      avatar_(source_.load()),  // before a window opens for one that is not there
      preferences_(readPreferences(options.state)),
      ownWindow_(window ? std::move(window)
                        : std::make_unique<Window>(windowOptions(options, preferences_))),
      window_(*ownWindow_),
      device_(openDevice(options.device, window_)),
      movingSamples_(options.smoothWithin.value_or(device_->info().cpu ? 0 : 5)),
      making_(std::move(making)),
      madeShown_(making_ && absolutePath(making_->avatar()) == absolutePath(options.avatar)),
      library_(options.state.empty() ? fs::path() : options.state / "poses"),
      recovery_(options.state) {
    openKeys();
    useAvatar(avatar_);
    opened(options.avatar);
    const WindowOptions look = windowOptions(options, preferences_);
    uiScale_ = look.scale;
    settings_.theme = look.theme;
    if (settings_.theme == Theme::Light) settings_.colour = {.80f, .81f, .83f};
    settings_.texture = bestTexture();
    if (!avatar_->textured) settings_.paint = kPaintClay;

    Shot rest = restShot(*device_, avatar_->avatar, 512);
    editor_ = std::make_unique<PoseEditor>(poseOf(rest.theta, rest.trans), avatar_->avatar.betas);
    if (!options.motion.empty()) loadMotion(options.motion, options.frames);
    if (!options.pose.empty()) pastePose(options.pose);
    for (const fs::path& other : options.beside) compareWith(other);
    editor_->beginHere();  // all of it comes from files
    layOut();
    frameAll();
    if (!options.camera.empty()) orbit_ = readCameraText(options.camera);
    offerRecovery();
    lastTouched_ = lastPicture_ = lastTick_ = Clock::now();
}

Viewer::~Viewer() = default;

void Viewer::useAvatar(std::shared_ptr<LoadedAvatar> avatar) {
    painter_.reset();
    scene_.reset();
    avatar_ = std::move(avatar);
    const Avatar& now = avatar_->avatar;
    scene_ = std::make_unique<Scene>(*device_, now);
    painter_ = std::make_unique<Painter>(now, options_.device, [] { glfwPostEmptyEvent(); });
    // Until the networks have painted the view: what comes closest.
    const std::vector<float>& baked = now.bakedTexture.empty() ? now.texture : now.bakedTexture;
    textures_ = {{TextureKind::Coarse, now.texture},
                 {TextureKind::Refined, baked},
                 {TextureKind::Baked, baked}};
    painted_.clear();
    skeletonBetas_.reset();
    shapeNames_.reset();
    floorOf_.reset();
    behind_.clear();
    posePictures_ = {};
    ++textureVersion_;
    ++viewVersion_;
    if (inspected_) inspected_ = inspect(now, inspected_->point);
    if (training_.folder() != source_.folder()) training_ = TrainingWatch(source_.folder());
    showTitle();
}

// The stage is the one at its steps, which may be ahead of the avatar that the last one left.
void Viewer::showTitle() {
    std::string stage = avatar_->training ? avatar_->stage : "";
    if (training_.stage()) {
        const std::string now = "stage " + training_.stage()->stage;
        if (stage != now && !stage.starts_with(now + ",")) stage = now;
    }
    window_.setTitle(fmt::format(
        "{}{} - Doppel", fs::absolute(source_.folder()).lexically_normal().filename().string(),
        stage.empty() ? "" : fmt::format(" (in training: {})", stage)));
}

void Viewer::reloadIfChanged() {
    std::shared_ptr<LoadedAvatar> now = source_.changed();
    if (!now) return;
    if (unmixed_) {
        unmixed_ = std::move(now);
        beginMix();
        return say("the avatar that is mixed has changed on disk");
    }
    bool wasTextured = avatar_->textured, hadBest = settings_.texture == bestTexture();
    useAvatar(std::move(now));
    editor_->setOpenedBetas(avatar_->avatar.betas);
    if (!wasTextured && avatar_->textured && settings_.paint == kPaintClay)
        settings_.paint = kPaintTexture;
    if (hadBest) settings_.texture = bestTexture();
    say(avatar_->training ? "the training's present state: " + avatar_->stage
                          : "the avatar has changed on disk");
}

void Viewer::openAvatar(const fs::path& folder) {
    LiveAvatar source(folder);
    std::shared_ptr<LoadedAvatar> avatar = source.load();
    endDrag();
    unmixed_.reset();
    mixer_.chosen = {};
    mixSaved_ = true;
    source_ = std::move(source);
    useAvatar(std::move(avatar));
    editor_->setOpenedBetas(avatar_->avatar.betas);
    settings_.texture = bestTexture();
    settings_.paint = avatar_->textured ? kPaintTexture : kPaintClay;
    opened(folder);
    fitMotionAgain();
    say(fmt::format("the avatar {}{}", folder.filename().string(),
                    motion() && editor_->modified()
                        ? "; the motion, which you edited, stays as it was fitted to the one before"
                        : ""));
}

// A motion is fitted to the body that it was read for.
void Viewer::fitMotionAgain() {
    if (motion() && !motionFile_.empty() && !editor_->modified())
        loadMotion(motionFile_, motionFrames_);
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

// ---- messages -----------------------------------------------------------------------------------

void Viewer::say(std::string text, bool wrong) {
    messages_.push_back({std::move(text), wrong, Clock::now()});
    if (messages_.size() > kMostMessages) messages_.pop_front();
    framesToDraw_ = 3;
}

const std::string& Viewer::message() const {
    static const std::string kNone;
    return messages_.empty() ? kNone : messages_.back().text;
}

bool Viewer::messageVisible(const Message& message) const {
    double age = std::chrono::duration<double>(Clock::now() - message.since).count();
    return age < (message.wrong ? 15 : 5);
}

size_t Viewer::visibleMessages() const {
    return static_cast<size_t>(
        std::ranges::count_if(messages_, [&](const Message& m) { return messageVisible(m); }));
}

// ---- one turn -----------------------------------------------------------------------------------

bool Viewer::interacting() const {
    return drag_ != Drag::None || playing_ ||
           Clock::now() - lastTouched_ < std::chrono::duration<double>(kSettleSeconds);
}

bool Viewer::settled() const { return quiet() && !working(); }

bool Viewer::quiet() const {
    bool pictured =
        panes_.empty() || (shown_ && *shown_ == wanted() && refinements_ == kRefinements);
    return pictured && !interacting() && !painter_->busy() && !search_ && !mixer_.busy() &&
           framesToDraw_ == 0;
}

bool Viewer::frame() {
    if (window_.closed()) {
        if (editor_->modified() && givenUpVersion_ != editor_->version()) {
            window_.keepOpen();
            askToLeave();
        } else if (!mixSaved_) {
            window_.keepOpen();
            if (!question_)
                afterSavingMix("What is mixed is not saved.", [this] { window_.close(); });
        } else if (film_ && !leaveAfterFilm_) {
            window_.keepOpen();
            if (!question_) askToLeaveFilm();
        } else if (making_) {
            window_.keepOpen();
            if (!question_) askToLeaveMaking();
        } else if (!working()) {  // it is finished first
            recovery_.clear();
            return false;
        }
    }
    if (messagesDrawn_ != visibleMessages()) framesToDraw_ = std::max(framesToDraw_, 1);
    bool rests = quiet();
    // What comes from threads wakes the window.
    double wait = mixer_.busy()                          ? 0.05
                  : rests || painter_->busy() || search_ ? 0.25
                  : interacting() && !playing_           ? 0.02
                                                         : 0;
    if (refines() || (walk_ && walk_->goes)) wait = 0;
    if (framesToDraw_ > 0 || playing_) wait = 0;
    if (!drawable_) wait = 0.25;
    if (dialog_.isOpen()) wait = std::min(wait, 0.05);
    drawable_ = window_.begin(wait);
    reloadIfChanged();
    if (training_.update()) {
        framesToDraw_ = std::max(framesToDraw_, 1);
        showTitle();
    }
    followCompared();
    if (!question_)
        if (const auto path = dialog_.chosen()) attempt([&] { dialogThen_(*path); });
    advanceTimeline();
    noteCamera();
    if (working()) attempt([&] { advanceJobs(); });
    attempt([&] { advanceMix(); });
    attempt([&] { advanceMaking(); });
    keepSession(false);
    if (!drawable_) return true;
    if (window_.touched()) framesToDraw_ = 3;  // ImGui answers some events a frame later
    if (rests && quiet() && !tipPending()) return true;

    forgetItems();
    window_.beginFrame();
    openDropped();
    attempt([&] {
        handleKeys();
        layOut();
        handleMouse();
    });
    followMotion();
    attempt([&] { followInspected(); });
    updateTextures();
    updatePictures();
    drawOverlays();
    drawLegend();
    drawPanel();
    drawTimeline();
    drawStatus();
    drawTraining();
    drawHelp();
    drawQuestion();
    std::vector<PlacedPicture> placed;
    for (size_t i = 0; shown_ && i < panePictures_.size(); ++i)
        place(shown_->panes[i], panePictures_[i], placed);
    if (const auto preview = filmPreview()) {
        placed.push_back(*preview);
        drawFilmPreview(*preview);
    }
    auto drawn = Clock::now();
    window_.end(placed);
    times_.show = millisecondsSince(drawn);
    countPictures();
    if (framesToDraw_ > 0) --framesToDraw_;
    return true;
}

// How many there are in a second while something moves; turns that show the same one again are
// none.
void Viewer::countPictures() {
    if (pictures_ == picturesCounted_) return;
    picturesCounted_ = pictures_;
    constexpr double kPause = 400;  // milliseconds, after which it begins anew
    const double passed = millisecondsSince(lastPicture_);
    lastPicture_ = Clock::now();
    if (passed > kPause)
        pictureEvery_ = 0;
    else
        pictureEvery_ = pictureEvery_ > 0 ? std::lerp(pictureEvery_, passed, .2) : passed;
    times_.fps = pictureEvery_ > 0 ? 1000 / pictureEvery_ : 0;
}

void Viewer::run(const std::function<void()>& each) {
    try {
        do {
            if (each) each();
        } while (frame());
    } catch (const MachineError& error) {
        keepSession(true);
        fs::path kept;
        try {
            kept = freeName("doppel-pose", ".json");
            AtomicFile file(kept);
            file.write(editor_->copy());
            file.commit();
        } catch (const std::exception&) {
            throw error;
        }
        throwMachine("{}; the pose is kept in {}, which `doppel view --pose` takes{}", error.what(),
                     kept.string(),
                     recovery_.kept() ? ", and the next start offers all that was edited" : "");
    } catch (...) {
        keepSession(true);
        throw;
    }
}

// What goes wrong with a file is said in the window, which goes on. A device that is lost shows
// again where pictures are computed, and is not caught there.
void Viewer::attempt(const std::function<void()>& action) {
    try {
        action();
    } catch (const std::exception& error) {
        say(error.what(), true);
    }
}

// ---- the timeline -------------------------------------------------------------------------------

bool Viewer::hasKeys() const { return !editor_->keyframes().empty(); }
double Viewer::lastKey() const { return hasKeys() ? editor_->keyframes().back().time : 0; }

int64_t Viewer::frameCount() const {
    int64_t keys = static_cast<int64_t>(std::floor(lastKey())) + 1;
    return motion() ? static_cast<int64_t>(motion()->size()) : std::max<int64_t>(keys, 1);
}

int64_t Viewer::timelineEnd() const {
    return motion() ? frameCount() - 1 : std::max<int64_t>(frameCount() - 1, 120);
}

void Viewer::play(bool on) {
    auto last = static_cast<double>(frameCount() - 1);
    if (on && !playing_ && timeline_ >= last) timeline_ = 0;  // from the end it starts over
    playing_ = on && last > 0;
    lastTick_ = Clock::now();
}

void Viewer::step(int frames) {
    play(false);
    timeline_ = std::clamp(std::floor(timeline_) + frames, 0.0, static_cast<double>(timelineEnd()));
}

void Viewer::advanceTimeline() {
    auto now = Clock::now();
    double passed = std::chrono::duration<double>(now - lastTick_).count();
    lastTick_ = now;
    if (playing_) {
        auto last = static_cast<double>(frameCount() - 1);
        timeline_ += passed * speed_ * fps();
        if (timeline_ > last) {
            timeline_ = loop_ && last > 0 ? std::fmod(timeline_, last + 1) : last;
            playing_ = loop_ && last > 0;
        }
    }
    showTime();
}

// Puts the avatar where the timeline is. What is edited there is a key and comes along.
void Viewer::showTime() {
    double time = std::floor(timeline_);
    if (time == editor_->time() || drag_ == Drag::Joint || drag_ == Drag::Ring) return;
    editor_->goTo(time);
}

void Viewer::undo() {
    play(false);
    endDrag();
    noteCamera(true);
    editor_->undo();
    timeline_ = editor_->time();
    followCamera();
}

void Viewer::redo() {
    play(false);
    editor_->redo();
    timeline_ = editor_->time();
    followCamera();
}

void Viewer::noteCamera(bool now) {
    if (!preferences_.undoCamera || editor_->inGesture()) return;
    const bool rests = drag_ == Drag::None &&
                       Clock::now() - lastTouched_ >= std::chrono::duration<double>(kSettleSeconds);
    if (!now && !rests) return;
    std::string camera = cameraText(orbit_);
    if (camera == cameraNoted_ && !editor_->camera().empty()) return;
    cameraNoted_ = camera;
    editor_->moveCamera(std::move(camera));
}

void Viewer::undoCamera(bool on) {
    preferences_.undoCamera = on;
    if (!on) editor_->forgetCamera();
    writePreferences(options_.state, preferences_);
}

void Viewer::followCamera() {
    if (!preferences_.undoCamera || editor_->camera().empty() || editor_->camera() == cameraNoted_)
        return;
    orbit_ = readCameraText(editor_->camera());
    settings_.captureCamera = false;
    cameraNoted_ = cameraText(orbit_);
}

// What was seen of another motion.
void Viewer::followMotion() {
    if (motion() == motionSeen_) return;
    motionSeen_ = motion();
    ++backdropVersion_;
    backgroundKey_.fill(-1);
    if (!motion() || motion()->cameras.empty()) settings_.captureCamera = false;
    if (motion()) timeline_ = std::clamp(timeline_, 0.0, static_cast<double>(frameCount() - 1));
}

double Viewer::fps() const { return motion() && motion()->fps > 0 ? motion()->fps : 30; }

const Viewer::OpenCapture* Viewer::capture() const {
    for (const OpenCapture& open : captures_)
        if (motion() && open.motion.lock() == editor_->motion()) return &open;
    return nullptr;
}

const Viewer::OpenedMotion* Viewer::openedMotion() const {
    for (const OpenedMotion& open : motions_)
        if (motion() && open.motion.lock() == editor_->motion()) return &open;
    return nullptr;
}

}  // namespace doppel
