#include "trainer/data/progress.h"

#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "engine/error.h"
#include "engine/files/atomic_file.h"

namespace doppel {

namespace {

std::atomic<int> gSignal{0}, gCount{0};
static_assert(std::atomic<int>::is_always_lock_free, "signal handlers may set it");

void onSignal(int number) {
    constexpr int kDeadly = 3;
    int none = 0;
    gSignal.compare_exchange_strong(none, number);
    if (++gCount < kDeadly) return;
    removeTemporaryFiles();
    signal(number, SIG_DFL);
    raise(number);
}

using Clock = std::chrono::steady_clock;
double secondsBetween(Clock::time_point from, Clock::time_point to) {
    return std::chrono::duration<double>(to - from).count();
}

}  // namespace

void catchInterrupts() {
    gSignal = 0;
    gCount = 0;
    struct sigaction action {};
    action.sa_handler = onSignal;
    action.sa_flags = SA_RESTART;
    for (int number : {SIGINT, SIGTERM, SIGHUP}) {
        struct sigaction before {};
        sigaction(number, nullptr, &before);
        if (number == SIGHUP && before.sa_handler == SIG_IGN) continue;
        sigaction(number, &action, nullptr);
    }
}

bool interrupted() { return gSignal != 0; }

int interruptStatus() { return 128 + (gSignal != 0 ? gSignal.load() : SIGINT); }

std::string clockText(double seconds) {
    const auto total = static_cast<int64_t>(std::llround(std::max(0.0, seconds)));
    const int64_t hours = total / 3600, minutes = total / 60 % 60;
    if (hours > 0) return fmt::format("{}:{:02}:{:02}", hours, minutes, total % 60);
    return fmt::format("{}:{:02}", minutes, total % 60);
}

// ---- progress -----------------------------------------------------------------------------------

namespace {

// Between two lines where nobody sees one being rewritten.
double secondsBetweenLines() {
    const char* set = std::getenv("DOPPEL_PROGRESS");
    const std::string_view wish = set ? set : "";
    if (wish.empty()) return 10;
    double seconds = 0;
    const auto [end, error] = std::from_chars(wish.data(), wish.data() + wish.size(), seconds);
    if (error != std::errc() || end != wish.data() + wish.size() || !(seconds >= .1) ||
        !(seconds <= 3600))
        throwInput("DOPPEL_PROGRESS: expected seconds, .1 to 3600, or nothing, found {}", wish);
    return seconds;
}

}  // namespace

Progress::Progress(std::string what, int64_t total, double quiet)
    : what_(std::move(what)),
      total_(total),
      quiet_(quiet),
      terminal_(isatty(STDERR_FILENO) == 1),
      wait_(terminal_ ? .1 : secondsBetweenLines()),
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
    if (secondsBetween(start_, now) < quiet_) return;
    last_ = line(done, values, secondsBetween(start_, now));
    printed_ = false;
    if (done < total_ && secondsBetween(lastPrint_, now) < wait_) return;
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
