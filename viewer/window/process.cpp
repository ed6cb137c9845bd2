#include "viewer/window/process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "engine/error.h"

namespace doppel {

Process::~Process() { close(); }

Process::Process(Process&& other) noexcept
    : process_(std::exchange(other.process_, 0)), words_(std::exchange(other.words_, -1)) {}

void Process::close() {
    if (words_ >= 0) ::close(words_);
    words_ = -1;
    process_ = 0;
}

void Process::start(std::vector<std::string> words, const std::filesystem::path& log,
                    std::vector<std::string> settings) {
    close();
    const auto refuse = [&](int error) {
        close();
        throwMachine("{} cannot be started: {}", words[0], std::strerror(error));
    };
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    std::vector<char*> environment;  // the first of two of one name counts
    for (std::string& setting : settings) environment.push_back(setting.data());
    for (char** ours = environ; *ours; ++ours) environment.push_back(*ours);
    environment.push_back(nullptr);
    int ends[2] = {-1, -1};
    if (log.empty()) {
        if (pipe2(ends, O_CLOEXEC) != 0) refuse(errno);
        fcntl(ends[0], F_SETFL, O_NONBLOCK);
    } else {
        ends[1] = open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
        ends[0] = open(log.c_str(), O_RDONLY | O_CLOEXEC);
        if (ends[0] < 0 || ends[1] < 0) throwMachine("{}: {}", log.string(), std::strerror(errno));
        lseek(ends[0], 0, SEEK_END);  // others have written what is there
    }
    words_ = ends[0];
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, ends[1], STDOUT_FILENO);
    if (!log.empty()) posix_spawn_file_actions_adddup2(&files, ends[1], STDERR_FILENO);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    const int error = posix_spawnp(&process_, words[0].c_str(), &files, &attributes,
                                   arguments.data(), environment.data());
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&files);
    ::close(ends[1]);
    if (error != 0) refuse(error);
}

std::string Process::said() {
    std::string text;
    char buffer[4096];
    if (words_ < 0) return text;
    for (ssize_t count; (count = read(words_, buffer, sizeof buffer)) > 0;)
        text.append(buffer, static_cast<size_t>(count));
    return text;
}

std::optional<int> Process::ended() {
    int status = 0;
    if (process_ <= 0 || waitpid(process_, &status, WNOHANG) == 0) return {};
    process_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

void Process::send(int signal) {
    if (process_ > 0) kill(process_, signal);
}

void Process::end() {
    if (process_ > 0) {
        kill(process_, SIGTERM);
        waitpid(process_, nullptr, 0);
    }
    close();
}

}  // namespace doppel
