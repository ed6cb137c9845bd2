#include "trainer/import/clip.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "engine/io/video.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/pictures/sharpness.h"
#include "trainer/data/progress.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr int kSurveyRows = 360;  // pictures are looked at in this height
constexpr int kBlock = 8;         // pixels a side

// A picture is a duplicate where no block of it has changed by so much, in values of 255, in the
// mean over the block: less than a camera's noise.
constexpr double kDuplicateChange = .6;
// A picture is blurred where it has so much less of an edge than the median of those about it.
constexpr double kBlurredShare = .4;
constexpr size_t kAbout = 15;  // pictures before and behind
// A picture follows a cut where it, made very small so that motion counts little, differs from the
// one before by so much in the mean, and so many times as much as pictures about it do.
constexpr int kCutRows = 24;
constexpr double kCutChange = 18, kCutTimes = 4;

Image grey(const Image& picture) {
    Image result(picture.width, picture.height, 1);
    for (size_t i = 0; i < result.data.size(); ++i) {
        const uint8_t* p = &picture.data[3 * i];
        result.data[i] = uint8_t((54 * p[0] + 183 * p[1] + 19 * p[2] + 128) >> 8);
    }
    const int rows = std::min(kSurveyRows, picture.height);
    return resize(result, std::max(1, picture.width * rows / picture.height), rows);
}

// The mean change of the block that changed most.
double blockChange(const Image& a, const Image& b) {
    if (a.width != b.width || a.height != b.height) return 255;
    double worst = 0;
    for (int y = 0; y < a.height; y += kBlock) {
        for (int x = 0; x < a.width; x += kBlock) {
            const int right = std::min(x + kBlock, a.width),
                      bottom = std::min(y + kBlock, a.height);
            int total = 0;
            for (int i = y; i < bottom; ++i)
                for (int j = x; j < right; ++j) total += std::abs(a.row(i)[j] - b.row(i)[j]);
            worst = std::max(worst, double(total) / ((right - x) * (bottom - y)));
        }
    }
    return worst;
}

double meanChange(const Image& a, const Image& b) {
    if (a.data.size() != b.data.size()) return 255;
    int64_t total = 0;
    for (size_t i = 0; i < a.data.size(); ++i) total += std::abs(a.data[i] - b.data[i]);
    return double(total) / double(a.data.size());
}

// The median of values about i, itself left out.
double medianAbout(const std::vector<double>& values, size_t i) {
    std::vector<double> about;
    const size_t begin = i > kAbout ? i - kAbout : 0, end = std::min(i + kAbout + 1, values.size());
    for (size_t k = begin; k < end; ++k)
        if (k != i) about.push_back(values[k]);
    if (about.empty()) return values[i];
    const auto middle = about.begin() + std::ptrdiff_t(about.size() / 2);
    std::nth_element(about.begin(), middle, about.end());
    return *middle;
}

}  // namespace

// ---- reading ------------------------------------------------------------------------------------

fs::path clipFolder(const fs::path& folder) {
    std::error_code error;
    if (!fs::is_directory(folder, error)) return {};
    const fs::path images = folder / "images";
    if (!fs::exists(images, error)) return picturesOfFolder(folder).empty() ? fs::path() : folder;
    // Other folders and arrays belong to a layout, of which a part may be missing.
    for (const auto& entry : fs::directory_iterator(folder, error)) {
        const fs::path name = entry.path().filename();
        if (entry.is_directory(error) ? name != "images" && name != "masks"
                                      : name.extension() == ".npz")
            return {};
    }
    return !fs::is_directory(images, error) || picturesOfFolder(images).empty() ? fs::path()
                                                                                : images;
}

struct Clip::Source {
    std::optional<VideoReader> video;
    std::vector<fs::path> pictures;
    size_t next = 0;
    ImageSize size;  // of the first picture
    int rows = 0;
    double fps = 0, time = 0, start = 0;
    std::string damage;
};

Clip::Clip(const fs::path& source, const ClipOptions& options)
    : source_(std::make_unique<Source>()) {
    Source& s = *source_;
    s.rows = options.rows;
    s.fps = options.fps;
    std::error_code error;
    if (fs::is_directory(source, error)) {
        s.pictures = picturesOfFolder(source);
    } else {
        s.video.emplace(source, options.rows);
    }
}

Clip::~Clip() = default;

bool Clip::next(Image& picture) {
    Source& s = *source_;
    const bool first = s.next == 0;
    if (s.video) {
        try {
            if (!s.damage.empty() || !s.video->next(picture)) return false;
        } catch (const InputError& error) {
            if (first) throw;
            s.damage = error.what();  // what came before is good
            return false;
        }
        if (first) s.start = s.video->time();
        // Times that do not ascend are a damaged file's.
        s.time = first ? 0 : std::max(s.video->time() - s.start, s.time + 1e-4);
        ++s.next;
        return true;
    }
    if (s.next == s.pictures.size()) return false;
    const fs::path& file = s.pictures[s.next];
    picture = readImage(file);
    if (first) s.size = {picture.width, picture.height};
    if (!(s.size == ImageSize{picture.width, picture.height})) {
        throwInput("{}: expected {}×{} pixels, the size of {}, found {}×{}", file.string(),
                   s.size.width, s.size.height, s.pictures[0].filename().string(), picture.width,
                   picture.height);
    }
    if (picture.height > s.rows) {
        const double share = double(s.rows) / picture.height;
        picture = resize(picture, std::max(1, int(std::lround(picture.width * share))), s.rows);
    }
    s.time = double(s.next) / s.fps;
    ++s.next;
    return true;
}

double Clip::time() const { return source_->time; }

const std::string& Clip::damage() const { return source_->damage; }

double Clip::duration() const { return source_->video ? source_->video->duration() : 0; }

const char* Clip::highRange() const { return source_->video ? source_->video->highRange() : ""; }

double Clip::focalLength() const {
    if (source_->video) return source_->video->focalLength();
    return source_->pictures.empty() ? 0 : imageFocalLength(source_->pictures[0]);
}

int64_t Clip::expected() const {
    return source_->video ? source_->video->frameCount() : int64_t(source_->pictures.size());
}

// ---- choosing -----------------------------------------------------------------------------------

namespace {

// Leaves each so many of the kept ones, so that there are enough.
void takeEnough(const fs::path& source, std::vector<ClipFrame>& frames) {
    const auto kept = static_cast<size_t>(
        std::ranges::count_if(frames, [](const ClipFrame& f) { return f.fate == Fate::Kept; }));
    const size_t every = (kept + kEnoughFrames - 1) / kEnoughFrames;
    if (every < 2) return;
    size_t number = 0;
    for (ClipFrame& frame : frames)
        if (frame.fate == Fate::Kept && number++ % every != 0) frame.fate = Fate::Outside;
    fmt::print(stderr, "{}: of {} frames {} are taken, evenly; --every 1 takes all\n",
               source.string(), frames.size(), (kept + every - 1) / every);
}

}  // namespace

std::vector<ClipFrame> surveyClip(const fs::path& source, const ClipOptions& options) {
    Clip clip(source, options);
    std::vector<ClipFrame> frames;
    std::vector<double> sharpness, changes;  // of those between the times
    std::vector<size_t> looked;              // their numbers
    Image picture, before, lastKept;
    int64_t inTime = 0;
    Progress progress("look at frames", std::max<int64_t>(clip.expected(), 0));
    while (clip.next(picture)) {
        if (interrupted()) throw Interrupted{};
        ClipFrame frame{clip.time()};
        progress.update(int64_t(frames.size()) + 1);
        const bool between = frame.time >= options.from && frame.time < options.to;
        if (!between || inTime++ % std::max<int64_t>(options.every, 1) != 0)
            frame.fate = Fate::Outside;
        if (between) {
            Image small = grey(picture);
            Image tiny = resize(picture, kCutRows * picture.width / picture.height + 1, kCutRows);
            looked.push_back(frames.size());
            sharpness.push_back(doppel::sharpness(
                small.width, small.height, [&](int x, int y) { return double(small.row(y)[x]); },
                [](int, int) { return true; }));
            changes.push_back(before.empty() ? 0 : meanChange(tiny, before));
            if (frame.fate == Fate::Kept && !options.keepSimilar) {
                if (!lastKept.empty() && blockChange(small, lastKept) < kDuplicateChange) {
                    frame.fate = Fate::Duplicate;
                } else {
                    lastKept = std::move(small);
                }
            }
            before = std::move(tiny);
        }
        frames.push_back(frame);
    }
    for (size_t k = 0; k < looked.size(); ++k) {
        ClipFrame& frame = frames[looked[k]];
        frame.cut = changes[k] > kCutChange && changes[k] > kCutTimes * medianAbout(changes, k);
        if (frame.fate == Fate::Kept && !options.keepSimilar &&
            sharpness[k] < kBlurredShare * medianAbout(sharpness, k)) {
            frame.fate = Fate::Blurred;
        }
    }
    if (options.every == 0 && options.frames.empty()) takeEnough(source, frames);
    if (!options.frames.empty()) {
        std::vector<bool> chosen(frames.size());
        for (size_t i : selectFrames(options.frames, frames.size())) chosen[i] = true;
        for (size_t i = 0; i < frames.size(); ++i)
            if (!chosen[i]) frames[i].fate = Fate::Outside;
    }
    if (std::ranges::none_of(frames, [](const ClipFrame& f) { return f.fate == Fate::Kept; })) {
        throwInput("{}: expected pictures from {} s on, found {} that last {:.2f} s",
                   source.string(), options.from, frames.size(),
                   frames.empty() ? 0 : frames.back().time);
    }
    return frames;
}

double keptRate(const std::vector<ClipFrame>& frames, double otherwise) {
    double first = 0, last = 0;
    int64_t count = 0;
    for (const ClipFrame& frame : frames) {
        if (frame.fate != Fate::Kept) continue;
        if (count++ == 0) first = frame.time;
        last = frame.time;
    }
    return count > 1 ? double(count - 1) / (last - first) : otherwise;
}

std::string leftOut(const std::vector<ClipFrame>& frames) {
    std::vector<std::string> parts;
    for (const auto& [fate, what] : {std::pair{Fate::Duplicate, "duplicates"},
                                     {Fate::Blurred, "blurred"},
                                     {Fate::Nobody, "without the person"},
                                     {Fate::Doubtful, "with a doubtful mask"}}) {
        const auto count = std::ranges::count_if(
            frames, [&, f = fate](const ClipFrame& c) { return c.fate == f; });
        if (count > 0) parts.push_back(fmt::format("{} {}", count, what));
    }
    return fmt::format("{}", fmt::join(parts, ", "));
}

std::string endsEarly(const std::vector<ClipFrame>& frames, double duration) {
    const double end = frames.empty() ? 0 : frames.back().time;
    // Sound may go on for a moment.
    if (end + std::max(.5, .05 * duration) >= duration) return {};
    return fmt::format("at {:.2f} s of {:.2f} s", end, duration);
}

std::string cutsOf(const std::vector<ClipFrame>& frames) {
    std::vector<std::string> parts;
    for (size_t i = 0; i < frames.size(); ++i)
        if (frames[i].cut) parts.push_back(fmt::format("{:.2f} s (frame {})", frames[i].time, i));
    return fmt::format("{}", fmt::join(parts, ", "));
}

}  // namespace doppel
