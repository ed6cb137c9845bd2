#include "viewer/start/start_window.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/error.h"
#include "viewer/live/live_avatar.h"
#include "viewer/widgets.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr int kWidth = 720, kHeight = 600;       // of the window
constexpr float kDropHeight = 120, kCard = 132;  // units

// The first of a preview's two views: a square at its left.
CanvasImage firstView(const Image& preview, int side) {
    const int square = std::min(preview.width, preview.height);
    Image view(square, square, 3);
    for (int y = 0; y < square; ++y) std::copy_n(preview.pixel(0, y), 3 * square, view.pixel(0, y));
    const Image scaled = resize(view, side, side);
    CanvasImage image{side, side, {}};
    for (size_t i = 0; i < scaled.data.size(); i += 3)
        image.pixels.push_back(0xff000000u | static_cast<uint32_t>(scaled.data[i + 2]) << 16 |
                               static_cast<uint32_t>(scaled.data[i + 1]) << 8 | scaled.data[i]);
    return image;
}

// Of a person's or a demo's folder rather than of the `avatar` in it.
std::string nameOf(const fs::path& avatar) {
    const fs::path whole = fs::absolute(avatar).lexically_normal();
    return whole.filename() == "avatar" && whole.has_parent_path()
               ? whole.parent_path().filename().string()
               : whole.filename().string();
}

WindowOptions startOptions(const ViewerOptions& viewer, const Preferences& preferences) {
    WindowOptions options = windowOptions(viewer, preferences);
    // Letters that are larger still scroll.
    const double larger = std::clamp(options.scale, 1., 1.5);
    options.width = static_cast<int>(kWidth * larger);
    options.height = static_cast<int>(kHeight * larger);
    return options;
}

}  // namespace

StartWindow::StartWindow(const ViewerOptions& options)
    : options_(options),
      preferences_(readPreferences(options.state)),
      window_(std::make_unique<Window>(startOptions(options, preferences_))) {
    window_->present(nullptr);
    for (const fs::path path : preferences_.recent) {
        if (!LiveAvatar::isAvatar(path)) continue;
        known_.push_back({path, {}});
        try {
            known_.back().preview = readImage(path / "preview.png");
        } catch (const std::exception&) {
            continue;  // it is known by its name
        }
    }
    if (!options.avatar.empty()) attempt([&] { open(options_.avatar); });
}

bool StartWindow::frame() {
    if (chosen_) {
        drawOpening();
        return false;
    }
    if (window_->closed()) {
        if (!making_) return false;
        window_->keepOpen();
        if (!question_) askToLeave();
    }
    double wait = framesToDraw_ > 0 || tipPending() ? 0 : .25;
    if (dialog_.isOpen()) wait = std::min(wait, .05);
    const bool drawable = window_->begin(wait);
    if (!question_)
        if (const auto path = dialog_.chosen()) attempt([&] { open(*path); });
    attempt([&] { advanceMaking(); });
    if (window_->touched() || question_.appears()) framesToDraw_ = 3;
    if (!drawable || (framesToDraw_ == 0 && !tipPending())) return true;

    forgetItems();
    window_->beginFrame();
    openDropped();
    for (const KeyPress& press : window_->keys())
        if (const auto label = question_.answerOf(press)) answer(*label);
    draw();
    if (const auto label = question_.draw(window_->unit())) answer(*label);
    window_->end({});
    framesToDraw_ = std::max(framesToDraw_ - 1, 0);
    return true;
}

void StartWindow::answer(const std::string& label) {
    const std::function<void()> then = question_.take(label);  // which may ask again
    framesToDraw_ = 3;
    if (then) attempt(then);
}

void StartWindow::attempt(const std::function<void()>& action) {
    try {
        action();
    } catch (const std::exception& error) {
        say(error.what(), true);
    }
}

void StartWindow::say(std::string text, bool wrong) {
    message_ = std::move(text);
    wrong_ = wrong;
    framesToDraw_ = 3;
}

// ---- what it does -------------------------------------------------------------------------------

void StartWindow::open(const fs::path& path) {
    if (const std::optional<fs::path> avatar = LiveAvatar::at(path)) return choose(*avatar);
    std::error_code ignored;
    if (!fs::exists(path, ignored))
        throwInput("{}: expected an avatar, a clip or a folder of pictures, found nothing",
                   path.string());
    if (fs::exists(path / "capture.toml", ignored))
        throwInput(
            "{}: expected an avatar, found a capture; `doppel train {} --out AVATAR` makes one",
            path.string(), path.string());
    if (!Making::takes(path))
        throwInput(
            "{}: expected an avatar's folder, a clip, or a folder of pictures; what else there is "
            "is opened once there is an avatar",
            path.string());
    if (making_)
        throwInput("{}: an avatar of {} is being made already; one at a time", path.string(),
                   making_->clip().filename().string());
    question_.ask(questionToMake(path, [this, path] {
        message_.clear();
        making_.emplace(options_.program, path, options_.device.name);
    }));
    framesToDraw_ = 3;
}

void StartWindow::openDropped() {
    const std::vector<fs::path> now = window_->dropped();
    dropped_.insert(dropped_.end(), now.begin(), now.end());
    // An avatar takes the others with it.
    std::ranges::stable_partition(
        dropped_, [](const fs::path& path) { return LiveAvatar::at(path).has_value(); });
    while (!question_ && !chosen_ && !dropped_.empty()) {
        const fs::path path = std::move(dropped_.front());
        dropped_.pop_front();
        attempt([&] { open(path); });
    }
}

// Read here as well, for what is wrong with it is said where another one can be chosen.
void StartWindow::choose(const fs::path& avatar) {
    LiveAvatar(avatar).load();
    chosen_ = avatar;
}

std::unique_ptr<Window> StartWindow::takeWindow() {
    const std::vector<fs::path> left(dropped_.begin(), dropped_.end());
    window_->drop(left);
    return std::move(window_);
}

void StartWindow::advanceMaking() {
    if (!making_) return;
    const bool news = making_->update() || making_->status();
    if (!news || question_) return;
    framesToDraw_ = 3;
    const fs::path avatar = making_->avatar();
    if (making_->status()) {
        const Making made = std::move(*making_);
        making_.reset();
        say(made.ending(), false);
    }
    if (LiveAvatar::isAvatar(avatar) && !(making_ && making_->stops())) choose(avatar);
}

void StartWindow::askToLeave() {
    question_.ask(questionToLeave(
        *making_,
        [this] {
            making_->stop();
            making_.reset();
            window_->close();
        },
        [this] {
            making_.reset();
            window_->close();
        }));
    framesToDraw_ = 3;
}

void StartWindow::askForFile(FileDialog::Asks asks, const char* title) {
    const fs::path start =
        known_.empty() ? fs::current_path() / "" : known_[0].folder.parent_path() / "";
    dialog_.open(asks, title, start);
}

// ---- what it shows ------------------------------------------------------------------------------

void StartWindow::draw() {
    ImGui::SetNextWindowPos({0, 0});
    ImGui::SetNextWindowSize(ImGui::GetIO().DisplaySize);
    ImGui::Begin("start", nullptr, kFixed);
    if (making_)
        drawMaking();
    else
        drawDropPlace();
    if (!message_.empty()) {
        ImGui::Spacing();
        const StatusColours colours = statusColours(options_.theme.value_or(preferences_.theme));
        ImGui::PushStyleColor(ImGuiCol_Text, wrong_ ? colours.bad : colours.good);
        words(message_);
        ImGui::PopStyleColor();
    }
    drawKnown();
    ImGui::End();
}

// Reading it takes a moment, and the device's programs may have to be compiled.
void StartWindow::drawOpening() {
    window_->become(windowOptions(options_, preferences_));
    if (!window_->begin(0)) return;
    forgetItems();
    window_->beginFrame();
    ImGui::SetNextWindowPos({0, 0});
    ImGui::SetNextWindowSize(ImGui::GetIO().DisplaySize);
    ImGui::Begin("start", nullptr, kFixed);
    words(fmt::format("Opens {} ...", nameOf(*chosen_)));
    ImGui::End();
    window_->end({});
}

void StartWindow::drawDropPlace() {
    const auto unit = static_cast<float>(window_->unit());
    const float wide = ImGui::GetContentRegionAvail().x;
    ImGui::Dummy({wide, kDropHeight * unit});
    const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
    ImDrawList& list = *ImGui::GetWindowDrawList();
    list.AddRectFilled(low, high, ImGui::GetColorU32(ImGuiCol_FrameBg), 8 * unit);
    constexpr const char* kDrop = "Drop a clip, a folder of pictures or an avatar here.";
    const float wrap = wide - 40 * unit;
    const ImVec2 size = ImGui::CalcTextSize(kDrop, nullptr, false, wrap);
    list.AddText(
        ImGui::GetFont(), ImGui::GetFontSize(),
        {std::round((low.x + high.x - size.x) / 2), std::round((low.y + high.y - size.y) / 2)},
        ImGui::GetColorU32(ImGuiCol_Text), kDrop, nullptr, wrap);
    hint(
        "A clip or pictures of one person become an avatar, which takes minutes: seen from head to "
        "toe, turning once, in even light. It is made on this machine, beside the clip.");
    ImGui::Spacing();
    words("Or name it:");
    const bool entered =
        pathField("An avatar's folder, a clip or a folder of pictures; Enter opens it.", pathText_,
                  window_->keys());
    const bool named = pathText_[0] != 0;
    if ((button("open", "The avatar, or the clip, of this name.", named) || entered) && named)
        attempt([&] { open(typedPath(pathText_)); });
    const bool asks = FileDialog::isThere();
    const std::string none = asks ? "" : " It needs zenity or kdialog, which are not installed.";
    beside("choose a clip");
    if (button("choose a clip", "In the desktop's dialog." + none, asks))
        attempt([&] { askForFile(FileDialog::Asks::File, "Make an avatar of a clip"); });
    beside("choose a folder");
    if (button("choose a folder", "An avatar, or pictures." + none, asks))
        attempt([&] { askForFile(FileDialog::Asks::Folder, "Open an avatar, or pictures"); });
}

void StartWindow::drawMaking() {
    words(fmt::format("An avatar is being made of {}:", making_->clip().filename().string()));
    words(making_->stops() ? "stops" : making_->brief());
    if (const std::optional<double> share = making_->share()) {
        ImGui::ProgressBar(static_cast<float>(*share),
                           {-1, 6 * static_cast<float>(window_->unit())}, "");
        noteItem("progress");
    }
    hint("It is opened as soon as there is something to see, and goes on meanwhile.");
    if (button("stop making it", "What is done stays; the clip, dropped again, goes on.",
               !making_->stops())) {
        making_->stop();
        framesToDraw_ = 3;
    }
}

void StartWindow::drawKnown() {
    ImGui::Spacing();
    if (known_.empty()) {
        if (making_) return;
        hint(
            "`doppel demo` makes an avatar of a synthetic person in some minutes, and shows what "
            "Doppel does.");
        return;
    }
    ImGui::Separator();
    ImGui::Spacing();
    words("Opened before:");
    const auto unit = static_cast<float>(window_->unit());
    const float space = ImGui::GetStyle().ItemSpacing.x, wide = ImGui::GetContentRegionAvail().x;
    const int perRow = std::max(1, static_cast<int>((wide + space) / (kCard * unit + space)));
    int count = 0;
    for (Known& known : known_) {
        if (count++ % perRow != 0) ImGui::SameLine();
        drawCard(known, std::min(kCard * unit, wide));
    }
}

void StartWindow::drawCard(Known& known, float side) {
    const auto unit = static_cast<float>(window_->unit());
    const std::string name = nameOf(known.folder);
    const float line = ImGui::GetTextLineHeightWithSpacing();
    ImGui::PushID(known.folder.c_str());
    if (ImGui::InvisibleButton("card", {side, side + line})) attempt([&] { choose(known.folder); });
    const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax(),
                 corner{high.x, low.y + side};
    noteItem(name);
    tip(known.folder.string());
    ImDrawList& list = *ImGui::GetWindowDrawList();
    if (known.preview.empty()) {
        list.AddRectFilled(low, corner, ImGui::GetColorU32(ImGuiCol_FrameBg));
    } else {
        const int pixels = std::max(1, static_cast<int>(std::lround(side * window_->scale())));
        if (known.shown.width != pixels) known.shown = firstView(known.preview, pixels);
        list.AddImage(&known.shown, low, corner);
    }
    if (ImGui::IsItemHovered()) list.AddRect(low, corner, ImGui::GetColorU32(ImGuiCol_Text));
    list.PushClipRect(low, high, true);
    list.AddText({low.x, corner.y + 2 * unit}, ImGui::GetColorU32(ImGuiCol_Text), name.c_str());
    list.PopClipRect();
    ImGui::PopID();
}

}  // namespace doppel
