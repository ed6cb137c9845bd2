#include "trainer/data/progress.h"

#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>

namespace doppel {

namespace {

std::atomic<bool> gInterrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "signal handlers may set it");

using Clock = std::chrono::steady_clock;
double secondsBetween(Clock::time_point from, Clock::time_point to) {
    return std::chrono::duration<double>(to - from).count();
}

}  // namespace

void catchInterrupts() {
    gInterrupted = false;
    struct sigaction action {};
    action.sa_handler = [](int) { gInterrupted = true; };
    // Once: the second Ctrl-C finds the default again, which ends the program.
    action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
    sigaction(SIGINT, &action, nullptr);
}

bool interrupted() { return gInterrupted; }

std::string clockText(double seconds) {
    const auto total = static_cast<int64_t>(std::llround(std::max(0.0, seconds)));
    const int64_t hours = total / 3600, minutes = total / 60 % 60;
    if (hours > 0) return fmt::format("{}:{:02}:{:02}", hours, minutes, total % 60);
    return fmt::format("{}:{:02}", minutes, total % 60);
}

// ---- progress -----------------------------------------------------------------------------------

Progress::Progress(std::string what, int64_t total)
    : what_(std::move(what)),
      total_(total),
      terminal_(isatty(STDERR_FILENO) == 1),
      start_(Clock::now()),
      lastPrint_(start_) {}

Progress::~Progress() {
    if (last_.empty()) return;
    if (terminal_) {
        print(last_, true);
    } else if (!printed_) {
        print(last_, true);
    }
}

std::string Progress::line(int64_t done, const Values& values, double seconds) const {
    std::string text = fmt::format("{} {}/{}", what_, done, total_);
    for (const auto& [name, value] : values) text += fmt::format("  {} {:.4g}", name, value);
    const int64_t since = done - std::max<int64_t>(first_, 0);
    if (done >= total_) {
        text += fmt::format("  {} in all", clockText(seconds));
    } else if (since > 0 && seconds > 0) {
        text +=
            fmt::format("  {} left", clockText(seconds / double(since) * double(total_ - done)));
    }
    return text;
}

void Progress::update(int64_t done, const Values& values) {
    const Clock::time_point now = Clock::now();
    // The work of a resumed run that was done before does not count for the time left.
    if (first_ < 0) {
        first_ = done > 1 ? done : 0;
        if (done > 1) start_ = now;
    }
    done_ = done;
    last_ = line(done, values, secondsBetween(start_, now));
    printed_ = false;
    const double wait = terminal_ ? .1 : 10;
    if (done < total_ && secondsBetween(lastPrint_, now) < wait) return;
    lastPrint_ = now;
    print(last_, false);
}

void Progress::print(const std::string& text, bool last) {
    if (terminal_) {
        // Carriage return, the text, and "erase to the end of the line".
        std::fprintf(stderr, "\r%s\x1b[K%s", text.c_str(), last ? "\n" : "");
    } else {
        std::fprintf(stderr, "%s\n", text.c_str());
    }
    std::fflush(stderr);
    printed_ = true;
}

void Progress::note(std::string_view text) {
    const int length = static_cast<int>(text.size());
    std::fprintf(stderr, "%s%.*s%s\n", terminal_ ? "\r" : "", length, text.data(),
                 terminal_ ? "\x1b[K" : "");
    std::fflush(stderr);
    if (terminal_ && !last_.empty()) print(last_, false);
}

}  // namespace doppel
