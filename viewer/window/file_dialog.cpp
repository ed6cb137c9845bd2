#include "viewer/window/file_dialog.h"

#include <unistd.h>

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
    process_.end();
    answer_.clear();
}

void FileDialog::open(Asks asks, const std::string& title, const fs::path& start) {
    end();
    const std::string program = dialogProgram();
    if (program.empty()) throwMachine("there is no dialog for files: install zenity or kdialog");
    process_.start(wordsOf(program, asks, title, start.string()));
}

std::optional<fs::path> FileDialog::chosen() {
    if (!process_.running()) return {};
    const auto listen = [&] {
        const std::string said = process_.said();
        if (answer_.size() < kLongestAnswer) answer_ += said;
    };
    listen();
    const std::optional<int> status = process_.ended();
    if (!status) return {};
    listen();  // to what it wrote between our reading and its end
    std::string name = std::move(answer_);
    end();
    if (*status != 0) return {};
    if (!name.empty() && name.back() == '\n') name.pop_back();
    if (name.empty() || name.size() >= kLongestAnswer) return {};
    return name;
}

}  // namespace doppel
