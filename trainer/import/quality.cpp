#include "trainer/import/quality.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>

#include "engine/files/atomic_file.h"

namespace doppel {

namespace {

constexpr size_t kLeastSure = 3;  // frames that are named
constexpr double kOften = .25;    // of the frames: worth a line

double meanOf(const ClipQuality& quality, double FrameQuality::*figure) {
    double sum = 0;
    for (const FrameQuality& frame : quality.frames) sum += frame.*figure;
    return sum / double(std::max<size_t>(quality.frames.size(), 1));
}

// How much may be wrong with a frame: for an order only.
double doubtOf(const FrameQuality& f) {
    return (1 - f.landmarks) + (1 - f.agreement) + f.doubtful + 3 * f.flicker.value_or(0);
}

std::optional<double> meanFlicker(const ClipQuality& quality) {
    double sum = 0, count = 0;
    for (const FrameQuality& frame : quality.frames)
        if (frame.flicker) sum += *frame.flicker, ++count;
    if (count == 0) return {};
    return sum / count;
}

std::vector<std::string> leastSure(const ClipQuality& quality) {
    std::vector<const FrameQuality*> order;
    for (const FrameQuality& frame : quality.frames) order.push_back(&frame);
    std::ranges::stable_sort(order, std::greater{},
                             [](const FrameQuality* f) { return doubtOf(*f); });
    std::vector<std::string> names;
    for (size_t i = 0; i < std::min(kLeastSure, order.size()); ++i) names.push_back(order[i]->name);
    return names;
}

}  // namespace

FrameQuality qualityOf(std::string name, const PersonLandmarks& person, int width, int height) {
    FrameQuality quality{.name = std::move(name), .presence = person.presence};
    double sum = 0;
    size_t count = 0;
    for (size_t i = landmark::kLeftShoulder; i < landmark::kCount; ++i, ++count)
        sum += person.points[i].visibility * person.points[i].presence;
    quality.landmarks = sum / double(count);
    for (size_t i : {landmark::kNose, landmark::kLeftAnkle, landmark::kRightAnkle}) {
        const auto& at = person.points[i].picture;
        if (at[0] < 0 || at[1] < 0 || at[0] > width || at[1] > height) quality.cutOff = true;
    }
    return quality;
}

std::string whyLeftOut(const ClipFrame& frame) {
    if (frame.fate == Fate::Duplicate) return "duplicate";
    return frame.fate == Fate::Blurred ? "blurred" : "";
}

std::string summary(const ClipQuality& quality) {
    const std::optional<double> flicker = meanFlicker(quality);
    return fmt::format(
        "masks agree with the network's to {:.3f} (IoU); {:.1f} % of the person's pixels are in "
        "doubt{}; landmarks are seen to {:.2f}; least sure: {}",
        meanOf(quality, &FrameQuality::agreement), 100 * meanOf(quality, &FrameQuality::doubtful),
        flicker ? fmt::format(", {:.1f} % flicker", 100 * *flicker) : "",
        meanOf(quality, &FrameQuality::landmarks), fmt::join(leastSure(quality), ", "));
}

std::string cutOff(const ClipQuality& quality) {
    const auto count = std::ranges::count_if(quality.frames, &FrameQuality::cutOff);
    if (double(count) < kOften * double(quality.frames.size()) || count == 0) return {};
    return fmt::format(
        "head or feet are outside of the picture in {} of {} frames; what is never seen will be "
        "made up: film the whole person, or leave these frames out (--from, --to, --frames)",
        count, quality.frames.size());
}

void writeQuality(const std::filesystem::path& file, const ClipQuality& quality) {
    using Json = nlohmann::ordered_json;
    Json json{{"frames", quality.frames.size()},
              {"frames_of_clip", quality.seen},
              {"masks", quality.masks},
              {"mask_agreement", meanOf(quality, &FrameQuality::agreement)},
              {"mask_doubtful", meanOf(quality, &FrameQuality::doubtful)},
              {"landmarks", meanOf(quality, &FrameQuality::landmarks)},
              {"least_sure", leastSure(quality)}};
    const auto orNull = [](const std::optional<double>& v) { return v ? Json(*v) : Json(); };
    json["mask_flicker"] = orNull(meanFlicker(quality));
    json["left_out"] = Json::array();
    for (const auto& left : quality.leftOut) {
        json["left_out"].push_back(
            {{"frame", left.number}, {"time", left.time}, {"why", left.why}});
        if (!left.picture.empty()) json["left_out"].back()["picture"] = left.picture;
    }
    json["per_frame"] = Json::object();
    for (const FrameQuality& f : quality.frames) {
        json["per_frame"][f.name] = {{"presence", f.presence},
                                     {"landmarks", f.landmarks},
                                     {"mask_agreement", f.agreement},
                                     {"mask_doubtful", f.doubtful},
                                     {"mask_flicker", orNull(f.flicker)},
                                     {"cut_off", f.cutOff}};
        if (!f.picture.empty()) json["per_frame"][f.name]["picture"] = f.picture;
    }
    AtomicFile out(file);
    // A folder's files may be called anything, also what is no UTF-8.
    out.write(json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
    out.commit();
}

std::optional<double> FlickerMeter::next(const std::vector<uint8_t>& mask) {
    std::optional<double> flicker;
    if (before_.size() == mask.size() && last_.size() == mask.size()) {
        double inside = 0, alone = 0;
        for (size_t i = 0; i < mask.size(); ++i) {
            const bool now = last_[i] > 0;
            inside += now;
            alone += (before_[i] > 0) != now && (mask[i] > 0) != now;
        }
        flicker = alone / std::max(inside, 1.);
    }
    before_ = std::move(last_);
    last_ = mask;
    return flicker;
}

void FlickerMeter::forget() {
    before_.clear();
    last_.clear();
}

}  // namespace doppel
