// How far the training is that goes on in an avatar's folder, by what it leaves there.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/avatar/checkpoint.h"

namespace doppel {

class TrainingWatch {
public:
    // The folder may not be there.
    explicit TrainingWatch(std::filesystem::path avatar);

    const std::filesystem::path& folder() const { return avatar_; }

    // Reads what has been written since the last time, at most twice a second. Whether there is
    // something new. Files that are not ours, or are being written, count as none.
    bool update();

    // The one at its steps, or whose steps were the last of a run that goes on; else nothing.
    const std::optional<StageRecord>& stage() const { return stage_; }
    int64_t done() const { return done_; }  // steps, with those before `stage()->first`
    // By the steps since the stage began here; nothing before there are two.
    std::optional<double> secondsLeft() const;
    // Since the last step, or the stage's begin.
    double secondsSinceStep() const;
    // No step has come for much longer than one takes: the training was stopped, or waits.
    bool stands() const;

    // Columns of the stage's losses, the sum first, and the last step's.
    const std::vector<std::string>& names() const { return names_; }
    const std::vector<double>& latest() const { return latest_; }
    const std::vector<float>& sums() const { return sums_; }  // of all steps

private:
    void readCurve();

    std::filesystem::path avatar_;
    std::chrono::steady_clock::time_point read_{};
    std::optional<StageRecord> stage_;
    uintmax_t at_ = 0;    // bytes of the curve that were read
    double written_ = 0;  // the curve was, last: seconds since 1970
    int64_t done_ = 0;
    std::vector<std::string> names_;
    std::vector<double> latest_;
    std::vector<float> sums_;
};

// The mean of the values in each of so many equal parts, one part for each value where there are
// fewer. Values that are not finite are left out, as are parts without others.
struct Curve {
    std::vector<double> at, value;  // at: 0 to 1
};
Curve thinned(const std::vector<float>& values, size_t parts);

}  // namespace doppel
