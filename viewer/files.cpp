// What is opened and saved, and what becomes of work that is not saved.
#include <GLFW/glfw3.h>

#include <algorithm>
#include <chrono>
#include <ctime>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "engine/io/films/kinds.h"
#include "trainer/avatar/rendering.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/motion/upright.h"
#include "viewer/pose/pose_text.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr double kGestureSeconds = 2;   // between two writings of the session while a limb moves
constexpr double kRestPerWriting = 20;  // times as long as a writing takes nothing is written
constexpr double kRetrySeconds = 5;     // after a writing that failed

fs::file_time_type timeOf(const fs::path& path) {
    std::error_code error;
    fs::file_time_type time = fs::last_write_time(path, error);
    return error ? fs::file_time_type{} : time;
}

// False where the folder cannot be looked into: whoever writes there says why.
bool isThere(const fs::path& path) {
    std::error_code ignored;
    return fs::exists(fs::symlink_status(path, ignored));
}

// What makes something of it that the window shows; empty: nothing does.
std::string importAdvice(const fs::path& path) {
    std::error_code ignored;
    if (!fs::is_directory(path, ignored) || isThere(path / "poses.npz")) return {};
    return fmt::format(
        "; `doppel import {} --out CAPTURE` makes a capture of pictures and of what other programs "
        "wrote",
        path.string());
}

// Or will be, once another window or a film has finished it.
bool isTaken(const fs::path& path) {
    return isThere(path) || isBeingWritten(path) || isFolderBeingWritten(path);
}

}  // namespace

// ---- opening ------------------------------------------------------------------------------------

// The motion, or the take, of a file as it is played in the window.
Take Viewer::readForPlaying(const fs::path& path, const std::string& frames) {
    std::optional<Take> take = frames.empty() ? readTake(path) : std::nullopt;
    std::vector<TrainedFrame> trained;
    std::shared_ptr<const Motion> played;
    if (!take) {
        Motion read = readMotion(path), source = read;
        if (const std::string taken = takenAs(read); !taken.empty())
            say(path.filename().string() + ": " + taken);
        const std::vector<TrainedFrame> known = trainedFrames(source_.folder(), read);
        Retargeted retargeted =
            performed(avatar_->avatar, source_.folder(), std::move(read), options_.retarget);
        if (!retargeted.summary.empty()) say(path.filename().string() + ": " + retargeted.summary);
        std::vector<size_t> chosen = selectFrames(frames, retargeted.motion.size());
        for (size_t i = 0; i < chosen.size(); ++i) {
            const auto at = std::ranges::lower_bound(known, chosen[i], {}, &TrainedFrame::frame);
            if (at != known.end() && at->frame == chosen[i])
                trained.push_back({i, at->theta, at->trans});
        }
        Motion motion = retargeted.motion.subset(chosen);
        source = source.subset(chosen);
        std::optional<Capture> pictures;
        if (motion.cameras.empty()) {
            // Upright, and where the avatar stands before it moves.
            motion = inCameraSpace(std::move(motion));
            source = inCameraSpace(std::move(source));
            const Trans place = restShot(*device_, avatar_->avatar, 512).trans;
            for (Motion* placed : {&motion, &source}) {
                const Trans first = placed->trans[0];
                for (Trans& trans : placed->trans)
                    for (size_t k = 0; k < 3; ++k) trans[k] += place[k] - first[k];
            }
        } else if (fs::is_directory(path / "images")) {
            pictures = readCapture(path).subset(chosen);
        }
        played = std::make_shared<const Motion>(std::move(source));
        take.emplace();
        take->motion = std::make_shared<const Motion>(std::move(motion));
        std::erase_if(captures_, [](const OpenCapture& open) { return open.motion.expired(); });
        if (pictures) {
            captures_.push_back({take->motion, std::move(*pictures), nullptr});
            captures_.back().frames = std::make_unique<FrameCache>(captures_.back().capture);
        }
    }
    std::erase_if(motions_, [](const OpenedMotion& open) { return open.motion.expired(); });
    if (take->motion) motions_.push_back({take->motion, path, frames, std::move(trained), played});
    return std::move(*take);
}

void Viewer::loadMotion(const fs::path& path, const std::string& frames) {
    Take take = readForPlaying(path, frames);
    const bool keyed = !take.keys.empty();
    play(false);
    endDrag();
    if (keyed)
        editor_->openTake(take, 0, "open " + path.filename().string());
    else
        editor_->openMotion(take.motion, "open " + take.motion->name);
    editor_->markSaved();
    if (keyed) savedFiles_[editor_->opening()] = {absolutePath(path)};
    timeline_ = 0;
    motionFile_ = path;
    motionFrames_ = frames;
    showTime();
    if (!motion() || motion()->cameras.empty()) settings_.captureCamera = false;
    ++backdropVersion_;
    layOut();
    frameAll();
    opened(path);
    say(keyed ? fmt::format("{}: {} keys", path.filename().string(), take.keys.size())
              : fmt::format("{}: {} frames", motion()->name, motion()->size()));
}

void Viewer::closeMotion() {
    play(false);
    endDrag();
    editor_->openMotion(nullptr, "close motion");
    editor_->markSaved();  // the pose that is left was the motion's
    settings_.captureCamera = false;
    motionFile_.clear();
    timeline_ = 0;
}

void Viewer::loadPicture(const fs::path& path) {
    backdropPicture_ = readImage(path);
    settings_.backdrop = Backdrop::Picture;
    ++backdropVersion_;
    opened(path);
}

void Viewer::pastePose(const fs::path& path) {
    std::vector<uint8_t> text = readWholeFile(path, uint64_t{1} << 20);
    try {
        editor_->paste({reinterpret_cast<const char*>(text.data()), text.size()});
    } catch (const InputError& error) {
        throwInput("{}: {}", path.string(), error.what());
    }
    opened(path);
}

void Viewer::openKeysFile(const fs::path& path) {
    chooseKeys(path.string());
    opened(path);
}

void Viewer::openPerson(const fs::path& folder) {
    afterSavingMix(fmt::format("Opening {} puts away what is mixed, which is not saved.",
                               folder.filename().string()),
                   [this, folder] { openAvatar(folder); });
}

void Viewer::openFile(const fs::path& path) {
    const bool mixes = settings_.panel && tab_ == kMixTab;
    if (const std::optional<fs::path> folder = LiveAvatar::at(path))
        return mixes ? mixWith(*folder) : openPerson(*folder);
    const std::string extension = endingOf(path);
    if (isMotion(path))
        afterSaving(fmt::format("Opening {} puts away what you edited, which is not saved.",
                                path.filename().string()),
                    [this, path] {
                        try {
                            loadMotion(path);
                        } catch (const InputError& error) {
                            if (Making::takes(path)) return askToMake(path);
                            throwInput("{}{}", error.what(), importAdvice(path));
                        }
                    });
    else if (extension == ".json")
        pastePose(path);
    else if (extension == ".toml")
        openKeysFile(path);
    else
        openPicture(path);
}

void Viewer::openPicture(const fs::path& path) {
    try {
        loadPicture(path);
    } catch (const InputError& error) {
        if (Making::takes(path)) return askToMake(path);
        const std::string advice = importAdvice(path);
        throwInput("{}{}", error.what(),
                   !advice.empty()
                       ? advice
                       : "; the window opens avatars, captures, clips, motions, poses (.json), "
                         "keys (.toml) and pictures");
    }
}

// Each may ask something; whatever is asked is answered before the next file is opened, for that
// would put another question in its place, or change what it is about.
void Viewer::openDropped() {
    const std::vector<fs::path> now = window_.dropped();
    if (question_ && !now.empty()) say("what was dropped is opened once the question is answered");
    dropped_.insert(dropped_.end(), now.begin(), now.end());
    while (!question_ && !dropped_.empty()) {
        const fs::path path = std::move(dropped_.front());
        dropped_.pop_front();
        attempt([&] { openFile(path); });
    }
}

void Viewer::askForFile(FileDialog::Asks asks, const std::string& title,
                        std::function<void(const fs::path&)> then, const fs::path& proposed) {
    fs::path start = fs::current_path() / proposed;
    if (asks != FileDialog::Asks::NewFile && !preferences_.recent.empty())
        start = fs::path(preferences_.recent[0]).parent_path() / "";
    dialogThen_ = std::move(then);
    dialog_.open(asks, title, fs::absolute(start));
}

void Viewer::chooseFile(FileDialog::Asks asks) {
    askForFile(asks,
               asks == FileDialog::Asks::File ? "Open a motion, a pose or a picture"
                                              : "Open an avatar, a capture or a folder of poses",
               [this](const fs::path& path) { openFile(path); });
}

void Viewer::chooseNewFile() {
    askForFile(
        FileDialog::Asks::NewFile, "Save the poses as .npz",
        [this](const fs::path& path) { saveAs(path); }, nameToWrite("poses", ".npz"));
}

void Viewer::opened(const fs::path& file) {
    remember(preferences_, file);
    writePreferences(options_.state, preferences_);
}

void Viewer::setLook(Theme theme, double scale) {
    // Backgrounds of their own colour go along with the theme.
    constexpr std::array<float, 3> kDark{0.20f, 0.22f, 0.25f}, kLight{.80f, .81f, .83f};
    if (settings_.colour == (settings_.theme == Theme::Light ? kLight : kDark))
        settings_.colour = theme == Theme::Light ? kLight : kDark;
    settings_.theme = theme;
    uiScale_ = std::clamp(scale, kSmallestScale, kLargestScale);
    window_.setLook(uiScale_, theme);
    preferences_.theme = theme;
    preferences_.scale = uiScale_;
    writePreferences(options_.state, preferences_);
    framesToDraw_ = 3;
}

// ---- saving -------------------------------------------------------------------------------------

// What is under way takes its name when it is done.
bool Viewer::isFree(const fs::path& path) const {
    const bool promised = (film_ && film_->out() == path) || (mixSave_ && mixSave_->out == path) ||
                          (export_ && export_->out == path);
    return !promised && !isTaken(path);
}

fs::path Viewer::freeName(const std::string& stem, const std::string& extension) const {
    for (int i = 1;; ++i) {
        fs::path path = fmt::format("{}-{}{}", stem, i, extension);
        if (isFree(path)) return path;
    }
}

fs::path Viewer::nameToWrite(const std::string& unnamed, const std::string& ending) const {
    fs::path named = typedPath(outText_);
    std::error_code ignored;
    const fs::path folder = fs::is_directory(named, ignored) ? named : named.parent_path();
    if (!folder.empty() && !fs::is_directory(folder, ignored))
        throwInput("{}: expected a folder that is there, found none; make it, or choose another",
                   folder.string());
    const std::string extension = ending.starts_with('.') ? ending : std::string();
    if (folder == named || !named.has_filename())
        return freeName((folder / unnamed).string(), extension);
    // Whoever named one kind of file writes others, too.
    const std::string typed = endingOf(named);
    if (videoKindOf(named) || typed == ".png" || typed == ".glb" || typed == ".npz")
        named.replace_extension();
    if (extension.empty()) named += ending;
    const std::string stem = named.string();
    const fs::path plain = stem + extension;
    return isFree(plain) ? plain : freeName(stem, extension);
}

void Viewer::chooseNameToWrite() {
    askForFile(
        FileDialog::Asks::NewFile, "Name films, pictures, glTF and poses",
        [this](const fs::path& path) {
            const std::string text = path.string();
            if (text.size() >= outText_.size())
                throwInput("{}: expected a name of fewer than {} bytes, found {}", text,
                           outText_.size(), text.size());
            outText_.fill(0);
            std::ranges::copy(text, outText_.begin());
            say("what is written is named " + text);
        },
        "doppel");
}

void Viewer::savePoses(const fs::path& path) {
    endDrag();
    editor_->endGesture();
    writeTake(path, editor_->take(), fps());
    editor_->markSaved();
    savedFiles_[editor_->opening()] = {absolutePath(path), timeOf(path)};
    keepSession(true);
    say(fmt::format("poses in {}", path.string()));
}

Viewer::SavedFile Viewer::savedFile() const {
    const auto found = savedFiles_.find(editor_->opening());
    return found == savedFiles_.end() ? SavedFile{} : found->second;
}

void Viewer::save() {
    const SavedFile file = savedFile();
    if (file.path.empty())
        savePoses(nameToWrite("poses", ".npz"));
    else if (isThere(file.path) && timeOf(file.path) != file.time)
        askToOverwrite(file.path);
    else
        savePoses(file.path);
}

void Viewer::saveAs(const fs::path& path) {
    fs::path out = path;
    if (endingOf(out) != ".npz") out += ".npz";
    const SavedFile file = savedFile();
    if (!isTaken(out) || (absolutePath(out) == file.path && timeOf(out) == file.time))
        savePoses(out);
    else
        askToOverwrite(out);
}

void Viewer::askToOverwrite(const fs::path& path) {
    ask({fmt::format("{} is there already, and what it holds was not saved from here.",
                     path.string()),
         {{"Save beside it",
           [this, path] {
               savePoses(freeName((path.parent_path() / path.stem()).string(), ".npz"));
           },
           "Under the next free name in the same folder."},
          {"Overwrite it", [this, path] { savePoses(path); }, "What is there is lost."},
          {"Cancel", {}, "Saves nothing."}}});
}

void Viewer::saveScreenshot(const fs::path& path) {
    if (!shown_) throwInput("there is no picture to save");
    const std::vector<Pane>& panes = shown_->panes;
    Image image(panes.back().x + panes.back().width, panes[0].height, 3);
    for (size_t i = 0; i < panes.size(); ++i) {
        const std::vector<uint32_t> pixels = seen(i);
        const uint32_t* word = pixels.data();
        for (int y = 0; y < panes[i].height; ++y)
            for (int x = 0; x < panes[i].width; ++x, ++word)
                for (int c = 0; c < 3; ++c)
                    image.pixel(panes[i].x + x, y)[c] = static_cast<uint8_t>(*word >> 8 * c);
    }
    writeImage(path, image);
    say(fmt::format("picture in {}", path.string()));
}

// ---- questions ----------------------------------------------------------------------------------

void Viewer::ask(Question question) {
    play(false);
    endDrag();
    question_.ask(std::move(question));
    framesToDraw_ = 3;
}

void Viewer::answer(const std::string& label) {
    const std::function<void()> then = question_.take(label);  // which may ask again
    framesToDraw_ = 3;
    if (then) attempt(then);
}

void Viewer::afterSaving(const std::string& what, std::function<void()> then) {
    if (!editor_->modified()) return then();
    ask({what,
         {{"Save",
           [this, then] {
               save();
               if (!editor_->modified()) then();
           },
           "Saves it, then goes on."},
          {"Do not save", then, "What you edited is lost."},
          {"Cancel", {}, "Leaves all as it is."}}});
}

void Viewer::afterSavingMix(const std::string& what, std::function<void()> then) {
    if (mixSaved_) return then();
    ask({what,
         {{"Save",
           [this, then] {
               saveMix(nameToWrite("mixed", "-mixed"));
               then();
           },
           "Writes it as a new avatar, then goes on."},
          {"Do not save",
           [this, then] {
               mixSaved_ = true;
               then();
           },
           "What is mixed is lost."},
          {"Cancel", {}, "Leaves all as it is."}}});
}

void Viewer::askToLeave() {
    afterSaving("What you edited is not saved.", [this] {
        givenUpVersion_ = editor_->version();
        window_.close();
    });
}

// ---- what a killed viewer leaves ----------------------------------------------------------------

std::string Viewer::sessionNow() const {
    Session session;
    session.avatar = absolutePath(source_.folder());
    for (const OpenedMotion& open : motions_)
        if (motion() && open.motion.lock() == editor_->motion()) {
            session.motion = absolutePath(open.path);
            session.frames = open.frames;
        }
    session.saved = savedFile().path.string();
    std::time_t now = std::time(nullptr);
    char when[32] = "";
    if (std::tm local{}; localtime_r(&now, &local))
        std::strftime(when, sizeof when, "%Y-%m-%d %H:%M", &local);
    session.when = when;
    session.time = std::max(editor_->time(), 0.0);
    session.edited = editor_->modified();
    session.take = editor_->take();
    session.worn = wornNow();
    return sessionText(session);
}

// Writes down what is not saved, once it has changed; a long list of keys less often.
bool Viewer::keepSession(bool now) {
    if (!recovery_.enabled()) return false;
    if (!editor_->modified() && mixSaved_) {
        recovery_.clear();
        keptVersion_ = 0;
        return true;
    }
    std::map<std::string, std::string> worn = wornNow();
    if (keptVersion_ == editor_->version() && keptWorn_ == worn) return true;
    double since = std::chrono::duration<double>(Clock::now() - keptAt_).count();
    if (!now && (since < kRestPerWriting * keptSeconds_ ||
                 (editor_->inGesture() && since < kGestureSeconds) ||
                 (keepingFailed_ && since < kRetrySeconds)))
        return false;
    auto before = Clock::now();
    try {
        recovery_.write(sessionNow());
        keptVersion_ = editor_->version();
        keptWorn_ = std::move(worn);
        keepingFailed_ = false;
    } catch (const std::exception& error) {
        if (!keepingFailed_)
            say(fmt::format("what is not saved cannot be kept for the next start: {}",
                            error.what()),
                true);
        keepingFailed_ = true;
    }
    keptAt_ = Clock::now();
    keptSeconds_ = std::chrono::duration<double>(keptAt_ - before).count();
    return !keepingFailed_;
}

bool Viewer::recover(const std::string& text, const std::string& name) {
    Session session = readSessionText(text, name);
    std::vector<std::string> missing;
    const auto without = [&](const char* what, const std::function<void()>& attempted) {
        try {
            attempted();
        } catch (const std::exception& error) {
            missing.push_back(fmt::format("{}: {}", what, error.what()));
        }
    };
    if (!session.motion.empty())
        without("not the motion under them", [&] {
            session.take.motion = readForPlaying(session.motion, session.frames).motion;
        });
    editor_->openTake(session.take, session.time, "bring back");
    if (!session.edited) editor_->markSaved();
    timeline_ = session.time;
    without("not what was taken of others", [&] { wear(session.worn); });
    // Without a time: somebody may have written it since.
    if (!session.saved.empty()) savedFiles_[editor_->opening()] = {session.saved};
    layOut();
    frameAll();
    if (!missing.empty())
        say(fmt::format("the poses are back, but {}", fmt::join(missing, "; ")), true);
    else if (session.edited)
        say(fmt::format("as it was at {}; {} saves it", session.when, keys_.keyOf(Action::Save)));
    else
        say(fmt::format("as it was at {}; \"{}\" saves it", session.when, kMixTab));
    return keepSession(true) && missing.empty();
}

void Viewer::offerRecovery() {
    const std::string avatar = absolutePath(source_.folder());
    for (Recovery::Orphan& found : recovery_.orphans()) {
        Session session;
        try {
            session = readSessionText(found.text, found.file.string());
        } catch (const InputError&) {
            continue;  // not of this program's version, or damaged: it stays where it is
        }
        if (session.avatar != avatar) continue;
        auto orphan = std::make_shared<Recovery::Orphan>(std::move(found));
        const size_t keys = session.take.keys.size();
        std::vector<std::string> lost;
        if (session.edited)
            lost.push_back(keys == 0   ? "a pose"
                           : keys == 1 ? "one key"
                                       : fmt::format("{} keys", keys));
        if (!session.worn.empty()) lost.push_back("what it wears of others");
        ask({fmt::format("At {} a window with this avatar ended before its work was saved: {}.",
                         session.when, fmt::join(lost, ", and ")),
             {{"Bring it back",
               [this, orphan] {
                   if (recover(orphan->text, orphan->file.string())) Recovery::remove(*orphan);
               },
               "The window shows it as it was, still to be saved."},
              {"Throw it away",
               [this, orphan] {
                   Recovery::remove(*orphan);
                   offerRecovery();
               },
               "It is lost."},
              {"Not now", {}, "It is asked again the next time."}}});
        return;
    }
}

}  // namespace doppel
