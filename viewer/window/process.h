// A program beside ours, so that the window goes on meanwhile, and what it says.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace doppel {

class Process {
public:
    Process() = default;
    ~Process();  // lets it run on
    Process(Process&& other) noexcept;
    Process& operator=(Process&&) = delete;

    // Starts words[0], looked for in $PATH, in the place of another that is let go; in a process
    // group of its own, so that Ctrl-C in our terminal does not stop it. What it says is what it
    // writes to its standard output; or, with a log, to that and to its errors, which the file gets
    // at its end: only so it may run on without us. settings: of its environment, NAME=value; the
    // rest is ours. MachineError where it cannot be started.
    void start(std::vector<std::string> words, const std::filesystem::path& log = {},
               std::vector<std::string> settings = {});
    bool running() const { return process_ > 0; }
    // What it has said since the last time; never waits.
    std::string said();
    // How it ended, once: its exit status, 128 and the signal that killed it. Nothing while it
    // runs.
    std::optional<int> ended();
    void send(int signal);  // where it runs
    void end();             // by SIGTERM, and waits for it

private:
    void close();

    pid_t process_ = 0;
    int words_ = -1;  // a pipe or the log, to read from
};

}  // namespace doppel
