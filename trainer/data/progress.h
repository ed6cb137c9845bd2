// What a long run tells while it goes: progress on stderr, curves in files, and whether the user
// pressed Ctrl-C.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace doppel {

// The user interrupted: exit interruptStatus(). Thrown by stages once their checkpoint is on disk.
struct Interrupted {
    std::string
        kept;  // what is left of the work: "checkpoint avatar/checkpoints/mesh"; may be empty
};

// From now on SIGINT (Ctrl-C), SIGTERM and SIGHUP make interrupted() true. The second one changes
// nothing, so that a hasty Ctrl-C does not spoil the checkpoint which the first has asked for; the
// third ends the program as it would have without us, but for temporary files, which are removed.
// SIGHUP stays ignored where it was (nohup). For commands that look at interrupted().
void catchInterrupts();
bool interrupted();
// 128 and the first signal's number, as shells have it: 130 for Ctrl-C.
int interruptStatus();

// Seconds of Progress::quiet, for what is short but of long recordings.
inline constexpr double kQuiet = 3;

// One line that is rewritten on a terminal; a line every ten seconds, or as many as DOPPEL_PROGRESS
// says, and the last, where stderr is a file or a pipe.
//
//     Progress progress("mesh", steps);
//     progress.update(step, {{"loss", loss}, {"iou", iou}});   // "mesh 120/400 loss .213 1:20
//     left"
class Progress {
public:
    using Values = std::vector<std::pair<std::string, double>>;

    // Of what takes fewer seconds than `quiet` nothing is said. InputError where DOPPEL_PROGRESS is
    // no number of seconds.
    Progress(std::string what, int64_t total, double quiet = 0);
    ~Progress();  // leaves the last line on the terminal
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    void update(int64_t done, const Values& values = {});
    // A line of its own, above the progress.
    void note(std::string_view text);

    // What update() would print now, for tests: seconds since the start given.
    std::string line(int64_t done, const Values& values, double seconds) const;

private:
    void print(const std::string& text, bool last);

    std::string what_;
    int64_t total_, done_ = 0, first_ = -1;  // first: where a resumed run began
    double quiet_;
    bool terminal_;
    double wait_;  // seconds between two lines
    std::chrono::steady_clock::time_point start_, lastPrint_;
    std::string last_;
    bool printed_ = false;
};

// "1:05:07", "2:09", "0:03".
std::string clockText(double seconds);

// Curves of one stage: FOLDER/losses_STAGE.csv (a column for the step and one per value) and
// TensorBoard events in FOLDER/events/STAGE. A resumed run (firstStep > 0) goes on from the rows
// before firstStep, so that it has one curve.
class LossLog {
public:
    LossLog(const std::filesystem::path& folder, std::string stage,
            std::vector<std::string> columns, int64_t firstStep = 0);
    ~LossLog();
    LossLog(const LossLog&) = delete;
    LossLog& operator=(const LossLog&) = delete;

    // values: one per column, in their order. InputError never; MachineError where the disk is
    // full.
    void add(int64_t step, const std::vector<double>& values);
    void flush();

private:
    struct Files;
    std::unique_ptr<Files> files_;
    std::string stage_;
    std::vector<std::string> columns_;
};

}  // namespace doppel
