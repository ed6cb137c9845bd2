#include "viewer/live/training_watch.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uintmax_t kMostBytes = 4u << 20;  // of a curve, in one reading
constexpr size_t kMostColumns = 64, kLongestRow = 4096, kMostRows = 10'000'000;

std::vector<std::string> split(const std::string& line) {
    std::vector<std::string> parts;
    for (size_t from = 0; from <= line.size() && parts.size() <= kMostColumns;) {
        const size_t comma = std::min(line.find(',', from), line.size());
        parts.push_back(line.substr(from, comma - from));
        from = comma + 1;
    }
    return parts;
}

std::optional<double> number(const std::string& text) {
    double value = 0;
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    if (result.ec != std::errc() || result.ptr != text.data() + text.size()) return std::nullopt;
    return value;
}

}  // namespace

TrainingWatch::TrainingWatch(fs::path avatar) : avatar_(std::move(avatar)) {}

bool TrainingWatch::update() {
    const auto now = std::chrono::steady_clock::now();
    if (now - read_ < std::chrono::milliseconds(500)) return false;
    read_ = now;
    const bool stood = stands();
    std::optional<StageRecord> stage;
    try {
        stage = readStageRecord(avatar_);
        // Between its stages a run shows the last of them.
        if (!stage && readRunRecord(avatar_)) stage = stage_;
    } catch (const std::exception&) {
    }
    const bool other = stage != stage_;
    if (other) {
        stage_ = stage;
        at_ = 0;
        done_ = stage ? stage->first : 0;
        written_ = stage ? stage->began : 0;
        names_.clear();
        latest_.clear();
        sums_.clear();
    }
    const uintmax_t before = at_;
    if (stage_) readCurve();
    return other || at_ != before || stands() != stood;
}

void TrainingWatch::readCurve() {
    const fs::path path = avatar_ / "log" / ("losses_" + stage_->stage + ".csv");
    std::error_code error;
    const uintmax_t size = fs::file_size(path, error);
    if (error || size <= at_) return;
    std::ifstream file(path, std::ios::binary);
    std::string text(std::min(size - at_, kMostBytes), '\0');
    if (!file.seekg(static_cast<std::streamoff>(at_)) ||
        !file.read(text.data(), static_cast<std::streamsize>(text.size())))
        return;
    // Whole lines; what comes after them is there next time.
    for (size_t from = 0, end; (end = text.find('\n', from)) != std::string::npos; from = end + 1) {
        at_ += end + 1 - from;
        if (end - from > kLongestRow || sums_.size() == kMostRows) continue;
        const std::vector<std::string> cells = split(text.substr(from, end - from));
        if (names_.empty()) {
            names_.assign(cells.begin() + 1, cells.end());
            continue;
        }
        std::vector<double> values;
        for (const std::string& cell : cells)
            if (const auto value = number(cell)) values.push_back(*value);
        if (values.size() != names_.size() + 1 || !std::isfinite(values[0])) continue;
        done_ = static_cast<int64_t>(std::clamp(values[0] + 1, 0., double(stage_->steps)));
        sums_.push_back(static_cast<float>(values[1]));
        latest_.assign(values.begin() + 1, values.end());
    }
    const auto written = fs::last_write_time(path, error);
    if (!error)
        written_ =
            std::max(stage_->began, std::chrono::duration<double>(
                                        std::chrono::file_clock::to_sys(written).time_since_epoch())
                                        .count());
}

std::optional<double> TrainingWatch::secondsLeft() const {
    if (!stage_ || done_ < stage_->first + 2) return std::nullopt;
    return (written_ - stage_->began) / static_cast<double>(done_ - stage_->first) *
           static_cast<double>(stage_->steps - done_);
}

double TrainingWatch::secondsSinceStep() const {
    return stage_ ? std::max(0., secondsSince1970() - written_) : 0;
}

bool TrainingWatch::stands() const {
    if (!stage_) return false;
    const auto taken = static_cast<double>(std::max<int64_t>(1, done_ - stage_->first));
    return secondsSinceStep() > 60 + 10 * (written_ - stage_->began) / taken;
}

Curve thinned(const std::vector<float>& values, size_t parts) {
    Curve curve;
    const size_t count = values.size();
    parts = std::min(parts, count);
    for (size_t p = 0; p < parts; ++p) {
        double sum = 0;
        size_t finite = 0;
        for (size_t i = p * count / parts; i < (p + 1) * count / parts; ++i)
            if (std::isfinite(values[i])) sum += values[i], ++finite;
        if (finite == 0) continue;
        curve.at.push_back(parts > 1 ? static_cast<double>(p) / static_cast<double>(parts - 1) : 0);
        curve.value.push_back(sum / static_cast<double>(finite));
    }
    return curve;
}

}  // namespace doppel
