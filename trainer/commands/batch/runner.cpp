#include "trainer/commands/batch/runner.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <thread>

#include "engine/error.h"
#include "engine/files/printable.h"
#include "trainer/data/progress.h"

namespace doppel::batch {

namespace {

using Clock = std::chrono::steady_clock;

constexpr int kNotStarted = 127;  // as a shell has it
// Of a job of which nothing is known.
constexpr uint64_t kUsualMemory = uint64_t{2} << 30;

struct UnderWay {
    size_t job, device;
    pid_t process;
    Clock::time_point since;
};

// In a process group of its own: what a terminal sends to ours comes from us, once. stdout becomes
// the job's result, stderr is added to its log.
pid_t start(const std::string& program, const Job& job, const std::string& device) {
    std::vector<std::string> words{program};
    words.insert(words.end(), job.words.begin(), job.words.end());
    if (job.restart) words.push_back("--restart");
    if (!device.empty()) words.insert(words.end(), {"--device", device});
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    const std::string log = job.log().string(), result = job.result().string();
    const pid_t parent = getpid(), process = fork();
    if (process < 0)
        throwMachine("{}: cannot be started for {} of {}: {}", program, job.step, job.person,
                     std::strerror(errno));
    if (process > 0) {
        setpgid(process, process);  // whoever of both is first
        return process;
    }
    // From here on only what POSIX allows between fork and exec.
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(kNotStarted);
    const auto become = [](int place, const char* path, int flags) {
        const int opened = open(path, flags, 0666);
        if (opened < 0 || dup2(opened, place) < 0) _exit(kNotStarted);
        if (opened != place) close(opened);
    };
    become(STDIN_FILENO, "/dev/null", O_RDONLY);
    become(STDOUT_FILENO, result.c_str(), O_WRONLY | O_CREAT | O_TRUNC);
    become(STDERR_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_APPEND);
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, nullptr);
    execv(program.c_str(), arguments.data());
    _exit(kNotStarted);
}

// ---- memory -------------------------------------------------------------------------------------

uint64_t availableMemory() {
    std::ifstream file("/proc/meminfo");
    for (std::string line; std::getline(file, line);)
        if (unsigned long kib = 0; std::sscanf(line.c_str(), "MemAvailable: %lu kB", &kib) == 1)
            return uint64_t{kib} << 10;
    return UINT64_MAX;
}

uint64_t memoryOf(pid_t process) {
    std::ifstream file(fmt::format("/proc/{}/statm", process));
    uint64_t all = 0, resident = 0;
    file >> all >> resident;
    return resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

// Whether another job is likely to fit beside those under way, each of which may yet grow to `one`
// bytes.
bool fits(std::span<const UnderWay> underWay, uint64_t one) {
    uint64_t needed = one;
    for (const UnderWay& job : underWay) needed += one - std::min(one, memoryOf(job.process));
    return underWay.empty() || needed <= availableMemory();
}

std::string lastLine(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    file.seekg(0, std::ios::end);
    const auto size = static_cast<std::streamoff>(file.tellg());
    file.seekg(std::max<std::streamoff>(0, size - 4096));
    std::string line, last;
    while (std::getline(file, line))
        if (!line.empty()) last = line;
    return printable(last, 300);
}

Outcome outcomeOf(const Job& job, int status, double seconds, uint64_t bytes) {
    Outcome outcome{.state = State::Done, .seconds = seconds, .bytes = bytes, .isNew = true};
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
        outcome.state = interrupted() ? State::Stopped : State::Failed;
        outcome.message = WIFSIGNALED(status) ? fmt::format("ended by signal {}", WTERMSIG(status))
                                              : fmt::format("exit {}", WEXITSTATUS(status));
        if (const std::string said = lastLine(job.log()); !said.empty())
            outcome.message += ": " + said;
    }
    if (outcome.state != State::Stopped) remember(job, outcome);
    return outcome;
}

}  // namespace

std::vector<Outcome> runJobs(const std::string& program, std::span<const Job> jobs,
                             const std::vector<std::string>& devices,
                             const std::function<void(std::span<const Outcome>)>& changed) {
    std::vector<Outcome> outcomes(jobs.size());
    uint64_t largest = 0;  // job's memory
    for (size_t i = 0; i < jobs.size(); ++i) {
        const bool before = !jobs[i].after || outcomes[*jobs[i].after].state == State::Done;
        const Outcome then = outcomeBefore(jobs[i]);
        if (then.state == State::Done && before) outcomes[i] = then;
        largest = std::max(largest, then.bytes);
    }
    auto count = [&](State state) { return std::ranges::count(outcomes, state, &Outcome::state); };
    const auto before = count(State::Done);
    if (before > 0) fmt::print(stderr, "{} of {} jobs are done from before\n", before, jobs.size());
    const auto began = Clock::now();
    std::vector<UnderWay> underWay;
    std::vector<bool> busy(devices.size());
    bool told = false;
    // Whatever ends this, no job is left without somebody to stop it.
    struct Guard {
        std::vector<UnderWay>& underWay;
        ~Guard() {
            for (const UnderWay& one : underWay) {
                kill(-one.process, SIGTERM);
                waitpid(one.process, nullptr, 0);
            }
        }
    } guard{underWay};
    for (;;) {
        for (auto at = underWay.begin(); at != underWay.end();) {
            int status = 0;
            rusage usage{};
            if (wait4(at->process, &status, WNOHANG, &usage) == 0) {
                ++at;
                continue;
            }
            const Job& job = jobs[at->job];
            const double seconds = std::chrono::duration<double>(Clock::now() - at->since).count();
            const uint64_t bytes = static_cast<uint64_t>(usage.ru_maxrss) << 10;
            largest = std::max(largest, bytes);
            outcomes[at->job] = outcomeOf(job, status, seconds, bytes);
            busy[at->device] = false;
            at = underWay.erase(at);
            const Outcome& outcome = outcomes[static_cast<size_t>(&job - jobs.data())];
            const auto now = count(State::Done) - before;
            const double left =
                std::chrono::duration<double>(Clock::now() - began).count() /
                static_cast<double>(std::max<int64_t>(1, now)) *
                static_cast<double>(static_cast<int64_t>(jobs.size()) - count(State::Done));
            if (outcome.state == State::Done)
                fmt::print(stderr, "{} {}: done in {}; {} of {} jobs, {} left\n", job.person,
                           job.step, clockText(seconds), count(State::Done), jobs.size(),
                           clockText(left));
            else
                fmt::print(stderr, "{} {}: {}; {}\n", job.person, job.step, outcome.message,
                           outcome.state == State::Stopped ? "it goes on when the batch does"
                                                           : job.log().string());
            changed(outcomes);
        }
        if (interrupted() && !told) {
            told = true;
            fmt::print(stderr, "stopping {} jobs; each keeps what it has\n", underWay.size());
            for (const UnderWay& one : underWay) kill(-one.process, SIGTERM);
        }
        for (size_t i = 0; i < jobs.size(); ++i) {
            if (outcomes[i].state != State::Waiting || !jobs[i].after) continue;
            const State first = outcomes[*jobs[i].after].state;
            if (first == State::Failed || first == State::LeftOut)
                outcomes[i].state = State::LeftOut;
        }
        for (size_t device = 0; device < devices.size() && !interrupted(); ++device) {
            if (busy[device] || !fits(underWay, largest > 0 ? largest : kUsualMemory)) continue;
            for (size_t i = 0; i < jobs.size(); ++i) {
                const Job& job = jobs[i];
                const bool isRunning = std::ranges::any_of(
                    underWay, [&](const UnderWay& one) { return one.job == i; });
                if (outcomes[i].state != State::Waiting || isRunning ||
                    (job.after && outcomes[*job.after].state != State::Done))
                    continue;
                fmt::print(stderr, "{} {}: {}\n", job.person, job.step, job.log().string());
                // What follows from it is made anew, also where this ends before that begins.
                for (size_t k = 0; k < jobs.size(); ++k)
                    if (k == i || jobs[k].after == i) forget(jobs[k]);
                underWay.push_back({i, device, start(program, job, devices[device]), Clock::now()});
                busy[device] = true;
                break;
            }
        }
        if (underWay.empty()) break;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return outcomes;
}

}  // namespace doppel::batch
