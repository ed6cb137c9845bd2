#include "viewer/window/file_dialog.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <vector>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr size_t kLongestAnswer = size_t{1} << 16;

bool isInPath(const std::string& program) {
    const char* path = std::getenv("PATH");
    std::istringstream folders(path ? path : "");
    for (std::string folder; std::getline(folders, folder, ':');)
        if (!folder.empty() && access((fs::path(folder) / program).c_str(), X_OK) == 0) return true;
    return false;
}

bool isKde() {
    const char* desktop = std::getenv("XDG_CURRENT_DESKTOP");
    return desktop && std::strstr(desktop, "KDE");
}

// The desktop's own first; empty: none.
std::string dialogProgram() {
    const char* programs[] = {"zenity", "kdialog"};
    if (isKde()) std::swap(programs[0], programs[1]);
    for (const char* program : programs)
        if (isInPath(program)) return program;
    return {};
}

std::vector<std::string> wordsOf(const std::string& program, FileDialog::Asks asks,
                                 const std::string& title, const std::string& start) {
    using Asks = FileDialog::Asks;
    if (program == "kdialog") {
        const char* what = asks == Asks::File     ? "--getopenfilename"
                           : asks == Asks::Folder ? "--getexistingdirectory"
                                                  : "--getsavefilename";
        return {program, "--title", title, what, start};
    }
    std::vector<std::string> words{program, "--file-selection", "--title=" + title,
                                   "--filename=" + start};
    if (asks == Asks::Folder) words.push_back("--directory");
    if (asks == Asks::NewFile) words.push_back("--save");
    return words;
}

}  // namespace

bool FileDialog::isThere() { return !dialogProgram().empty(); }

FileDialog::~FileDialog() { end(); }

void FileDialog::end() {
    if (process_ > 0) {
        kill(process_, SIGTERM);
        waitpid(process_, nullptr, 0);
    }
    process_ = 0;
    if (answers_ >= 0) close(answers_);
    answers_ = -1;
    answer_.clear();
}

void FileDialog::open(Asks asks, const std::string& title, const fs::path& start) {
    end();
    const std::string program = dialogProgram();
    if (program.empty()) throwMachine("there is no dialog for files: install zenity or kdialog");
    std::vector<std::string> words = wordsOf(program, asks, title, start.string());
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0)
        throwMachine("{} cannot be started: {}", program, std::strerror(errno));
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, ends[1], STDOUT_FILENO);
    const int error =
        posix_spawnp(&process_, program.c_str(), &files, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    close(ends[1]);
    answers_ = ends[0];
    fcntl(answers_, F_SETFL, O_NONBLOCK);
    if (error != 0) {
        process_ = 0;
        end();
        throwMachine("{} cannot be started: {}", program, std::strerror(error));
    }
}

std::optional<fs::path> FileDialog::chosen() {
    if (process_ <= 0) return {};
    char buffer[4096];
    for (;;) {
        const ssize_t count = read(answers_, buffer, sizeof buffer);
        if (count <= 0) break;
        if (answer_.size() < kLongestAnswer) answer_.append(buffer, static_cast<size_t>(count));
    }
    int status = 0;
    if (waitpid(process_, &status, WNOHANG) == 0) return {};
    process_ = 0;
    // What it wrote between our reading and its end.
    for (ssize_t count; (count = read(answers_, buffer, sizeof buffer)) > 0;)
        if (answer_.size() < kLongestAnswer) answer_.append(buffer, static_cast<size_t>(count));
    std::string name = std::move(answer_);
    end();
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) return {};
    if (!name.empty() && name.back() == '\n') name.pop_back();
    if (name.empty() || name.size() >= kLongestAnswer) return {};
    return name;
}

}  // namespace doppel
