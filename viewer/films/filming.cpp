// Films, which are drawn in the background while the window goes on, with what was drawn last in a
// corner of it.
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/io/films/kinds.h"
#include "viewer/films/film_thread.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// The kinds of films, and behind them a folder of pictures.
const std::vector<std::string>& filmKinds() {
    static const std::vector<std::string> kNames = [] {
        std::vector<std::string> names;
        for (const VideoKind& kind : videoKinds())
            names.push_back(fmt::format("{}, {}", kind.ending, kind.codec));
        names.emplace_back("pictures, PNG");
        return names;
    }();
    return kNames;
}

bool isPictures(int kind) { return size_t(kind) >= videoKinds().size(); }
bool keepsAlpha(int kind) { return isPictures(kind) || videoKinds()[size_t(kind)].keepsAlpha(); }

constexpr Choice kSizes[] = {{"as in the window", 0}, {"480", 480},   {"720", 720},
                             {"1080", 1080},          {"1920", 1920}, {"3840", 3840}};
constexpr Choice kSamples[] = {{"1", 1, "Edges have steps."},
                               {"4", 2},
                               {"16", 4, "The smoothest, and the slowest."}};  // per axis

constexpr float kPreviewSide = 170;  // window units

}  // namespace

void Viewer::startFilmAsSet() {
    FilmSettings asked = filmSettings_;
    asked.clear = asked.clear && keepsAlpha(filmKind_);
    startFilm(isPictures(filmKind_) ? nameToWrite("doppel-frames", "-frames")
                                    : nameToWrite("doppel", videoKinds()[size_t(filmKind_)].ending),
              asked);
}

void Viewer::savePicture() {
    const fs::path out = nameToWrite("doppel", ".png");
    if (pictureSettings_ == PictureSettings{})
        saveScreenshot(out);
    else
        drawPicture(out, pictureSettings_);
}

void Viewer::startFilm(const fs::path& out, const FilmSettings& settings) {
    FilmPlan plan = filmPlan(out, settings);
    const VideoOptions video{.alpha = settings.clear};
    plan.pictures = std::make_unique<PictureSequence>(out, plan.width, plan.height, fps(), video);
    draw(std::move(plan));
}

void Viewer::drawPicture(const fs::path& out, const PictureSettings& settings) {
    const int now = static_cast<int>(timeline_);
    constexpr int kFine = 4;
    draw(filmPlan(out, {.size = settings.size,
                        .first = now,
                        .last = now,
                        .clear = settings.clear,
                        .samples = kFine}));
}

void Viewer::draw(FilmPlan plan) {
    film_ = std::make_unique<FilmThread>(std::move(plan), [] { glfwPostEmptyEvent(); });
    filmPicture_ = {};
}

FilmPlan Viewer::filmPlan(const fs::path& out, const FilmSettings& settings) {
    if (film_) throwInput("a film or a picture is being drawn already");
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
    FilmPlan plan{.out = out,
                  .device = options_.device,
                  .avatar = avatar_,
                  .betas = editor_->betas(),
                  .mesh = pane.mesh,
                  .texture = pane.texture,
                  .painted = paintsViews(pane.texture) && settings_.paint == kPaintTexture,
                  .texels = textures_.at(pane.texture),
                  .shade = shadeOptions(pane),
                  .width = pane.width,
                  .height = pane.height,
                  .samples = settings.samples,
                  .clear = settings.clear,
                  .colour = settings_.colour,
                  .line = floorLine()};
    const bool captured = showsFrames() && !settings.turntable;
    if (captured) plan.capture = capture()->capture;
    plan.front = frameInFront();
    if (settings_.backdrop == Backdrop::Picture) plan.backdrop = backdropPicture_;
    const std::optional<Company::Row> row = this->row();
    for (size_t k = 0; row && k < others_.size(); ++k)
        plan.others.push_back({others_[k].loaded(),
                               others_[k].betasFor(plan.betas, avatar_->avatar),
                               others_[k].mesh(pane.mesh), others_[k].texture()});
    // A pose that is held still is seen from all sides as well.
    const bool held = settings.turntable && first == last;
    const int64_t count =
        held ? std::max<int64_t>(2, std::llround(settings.turnSeconds * fps())) : last - first + 1;
    for (int64_t k = 0; k < count; ++k) {
        const int64_t i = held ? first : first + k;
        // Without a timeline what is shown now.
        const double time = frameCount() > 1 ? static_cast<double>(i) : timeline_;
        FilmFrame frame;
        frame.pose = editor_->poseAt(time);
        frame.view = view();
        frame.camera = viewCameraOf(pane, time);
        if (settings.turntable) {
            const double turns = static_cast<double>(k) / static_cast<double>(count);
            frame.view = orbit_.turned(turns).view();
            frame.camera = orbit_.camera(pane.width, pane.height);
        }
        for (size_t other = 0; other < plan.others.size(); ++other)
            frame.offsets.push_back(others_.offset(other, plan.betas, avatar_->avatar, *row));
        if (!settings.clear) {
            if (settings_.floor) frame.floor = worldToFloor(time);
            frame.ghosts = ghosts(time);
        }
        if (captured) frame.captured = static_cast<size_t>(i);
        plan.frames.push_back(std::move(frame));
    }
    return plan;
}

void Viewer::advanceFilm() {
    if (std::optional<Image> latest = film_->latest()) {
        filmPicture_ = std::move(*latest);
        framesToDraw_ = std::max(framesToDraw_, 1);
    }
    if (!film_->ended()) return;
    const std::unique_ptr<FilmThread> film = std::move(film_);
    const bool leaves = std::exchange(leaveAfterFilm_, false);
    film->finish();
    say(fmt::format("{} in {}", film->isPicture() ? "picture" : "film", film->out().string()));
    if (leaves) window_.close();
}

void Viewer::cancelFilm() {
    if (!film_) return;
    film_.reset();
    say("the film was given up; nothing of it is left");
}

float Viewer::filmProgress() const { return film_ ? film_->progress() : 0; }

// Before an Escape too many loses an hour's work.
void Viewer::askToGiveFilmUp() {
    ask({fmt::format("{:.0f} % of the film are drawn.", 100. * filmProgress()),
         {{"Give it up", [this] { cancelFilm(); }, "Nothing of the film is left."},
          {"Go on", {}, "The film goes on being drawn."}}});
}

void Viewer::askToLeaveFilm() {
    ask({fmt::format("{:.0f} % of the film are drawn.", 100. * filmProgress()),
         {{"Finish it, then close",
           [this] {
               leaveAfterFilm_ = true;
               if (!film_) window_.close();
           },
           "The window closes by itself once the film is there."},
          {"Give it up",
           [this] {
               cancelFilm();
               window_.close();
           },
           "Closes now; nothing of the film is left."},
          {"Cancel", {}, "The window stays open."}}});
}

// In the upper right corner of the pictures; its pixels are as the window has them.
std::optional<PlacedPicture> Viewer::filmPreview() {
    if (!film_ || panes_.empty() || filmPicture_.empty()) return {};
    const Pane& last = panes_.back();
    const double unit = window_.unit() * window_.scale();
    const int wide = last.x + last.width,
              most = static_cast<int>(std::min(double{kPreviewSide} * unit, wide / 3.));
    const double scale =
        static_cast<double>(most) / std::max(filmPicture_.width, filmPicture_.height);
    const int width = std::max(1, static_cast<int>(filmPicture_.width * scale)),
              height = std::max(1, static_cast<int>(filmPicture_.height * scale));
    if (most < 24) return {};
    const Image small = resize(filmPicture_, width, height);
    filmPixels_.resize(small.data.size() / 3);
    for (size_t i = 0; i < filmPixels_.size(); ++i) {
        uint32_t word = 0xff000000u;
        for (size_t c = 0; c < 3; ++c) word |= uint32_t{small.data[3 * i + c]} << 8 * c;
        filmPixels_[i] = word;
    }
    const int edge = static_cast<int>(8 * unit);
    return PlacedPicture{wide - width - edge, edge, width, height, filmPixels_, {}, {}};
}

// A frame around it, and how far it is.
void Viewer::drawFilmPreview(const PlacedPicture& at) const {
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    const auto unit = static_cast<float>(window_.unit());
    const auto scale = static_cast<float>(window_.scale());
    const ImVec2 low{static_cast<float>(at.x) / scale, static_cast<float>(at.y) / scale},
        high{static_cast<float>(at.x + at.width) / scale,
             static_cast<float>(at.y + at.height) / scale};
    list.AddRect(low, high, IM_COL32(18, 19, 22, 255), 0, 0, unit);
    list.AddRectFilled({low.x, high.y}, {high.x, high.y + 5 * unit}, IM_COL32(18, 19, 22, 255));
    list.AddRectFilled({low.x, high.y},
                       {low.x + filmProgress() * (high.x - low.x), high.y + 5 * unit},
                       IM_COL32(120, 190, 255, 255));
    tipOver("The film's latest picture, and how much of it is drawn.", low,
            {high.x, high.y + 5 * unit});
}

void Viewer::drawFilmControls(bool enabled) {
    std::vector<Choice> kinds;
    for (const std::string& name : filmKinds()) {
        const int kind = static_cast<int>(kinds.size());
        kinds.push_back(
            {name.c_str(), kind, keepsAlpha(kind) ? "It may have nothing behind the avatar." : ""});
    }
    choose("film as", "The kind of file.", kinds.data(), kinds.size(), filmKind_);
    const bool alpha = keepsAlpha(filmKind_);
    choose("film size", "Pixels of the longer side.", kSizes, filmSettings_.size);
    if (const int end = int(frameCount()) - 1; end > 0) {
        int first = std::min(filmSettings_.first, end),
            last = filmSettings_.last < 0 ? end : std::min(filmSettings_.last, end);
        if (slider("first frame", "Of the film.", first, 0, end, "%d"))
            filmSettings_.first = first, last = std::max(first, last);
        if (slider("last frame", "Of the film, which has it too.", last, 0, end, "%d"))
            filmSettings_.first = std::min(filmSettings_.first, last);
        filmSettings_.last = last == end ? -1 : last;
    }
    ImGui::BeginDisabled(!alpha);
    bool clear = filmSettings_.clear && alpha;
    if (checkbox("nothing behind", "Transparent, for programs that put something there.", clear))
        filmSettings_.clear = clear;
    ImGui::EndDisabled();
    if (button("film",
               keys_.tip("Draws these frames as they are seen, in the background", Action::Film),
               enabled))
        attempt([&] { startFilmAsSet(); });
    beside("picture");
    if (button(
            "picture",
            keys_.tip("As it is seen now, or as large and clear as is said below", Action::Picture),
            enabled))
        attempt([&] { savePicture(); });
    // Whoever compares may expect both.
    if (panes_.size() > 1) {
        const bool first = panes_.back().other;
        const std::vector<std::string> names = paneNames();
        if (!names.empty())
            hint(fmt::format("of one pane: {}", first ? names.front() : names.back()));
    }
    // In a low window there is more below.
    const bool finer = ImGui::CollapsingHeader("more of films and pictures");
    noteItem("more of films and pictures");
    tip("Samples and a turntable for films; pictures of another size, or transparent.");
    if (finer) {
        choose("samples", "Per pixel of a film: more are smoother, and take as much longer.",
               kSamples, filmSettings_.samples);
        checkbox("turntable", "The camera goes once round, as render --camera turntable.",
                 filmSettings_.turntable);
        if (filmSettings_.turntable && frameCount() == 1)
            slider("seconds", "That going round the pose takes.", filmSettings_.turnSeconds, 1, 30,
                   "%d s");
        choose("picture size", "Pixels of the longer side of a picture.", kSizes,
               pictureSettings_.size);
        checkbox("transparent", "A picture with nothing behind the avatar, for other programs.",
                 pictureSettings_.clear);
    }
    if (!film_) return;
    ImGui::ProgressBar(filmProgress(), {-1, 0});
    if (button("give up", "Ends the film; nothing of it is left.")) cancelFilm();
}

}  // namespace doppel
