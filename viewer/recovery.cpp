#include "viewer/recovery.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/data/output_folder.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kLargestFile = uint64_t{256} << 20;

fs::path lockOf(fs::path file) { return file.replace_extension(".lock"); }

// Each session has names of its own, so nobody comes to write them again. What a viewer holds that
// lives stays.
void removeHalfWritten(const fs::path& folder) {
    std::vector<fs::path> paths;
    std::error_code error;
    for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
        paths.push_back(at->path());
    for (const fs::path& path : paths) {
        const std::string name = path.filename().string();
        const size_t part = name.find(".doppel-tmp-");
        FileLock lock;
        std::error_code ignored;
        if (name.starts_with(".view-") && part != std::string::npos)
            removeLeftovers(folder / (name.substr(1, part - 1) + ".json"));
        else if (name.starts_with("view-") && path.extension() == ".lock" &&
                 !fs::exists(fs::path(path).replace_extension(".json"), ignored) && lock.take(path))
            fs::remove(path, ignored);
    }
}

}  // namespace

fs::path userStateFolder() {
    const char* state = std::getenv("XDG_STATE_HOME");
    if (state && *state == '/') return fs::path(state) / "doppel";
    const char* home = std::getenv("HOME");
    if (home && *home) return fs::path(home) / ".local" / "state" / "doppel";
    return {};
}

std::string absolutePath(const fs::path& path) {
    std::error_code error;
    const fs::path found = fs::weakly_canonical(path, error);
    return (error ? fs::absolute(path, error) : found).string();
}

FileLock& FileLock::operator=(FileLock&& other) noexcept {
    if (this != &other) {
        release();
        descriptor_ = std::exchange(other.descriptor_, -1);
    }
    return *this;
}

bool FileLock::take(const fs::path& path) {
    release();
    const int opened = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (opened < 0) return false;
    struct stat of {
    }, there{};
    // Whoever held it may have deleted it in between; what is locked then is no file any more.
    const bool taken = flock(opened, LOCK_EX | LOCK_NB) == 0 && fstat(opened, &of) == 0 &&
                       stat(path.c_str(), &there) == 0 && of.st_ino == there.st_ino;
    if (taken)
        descriptor_ = opened;
    else
        close(opened);
    return taken;
}

void FileLock::release() {
    if (descriptor_ >= 0) close(std::exchange(descriptor_, -1));
}

Recovery::Recovery(const fs::path& state) {
    if (state.empty()) return;
    folder_ = state / "sessions";
    removeHalfWritten(folder_);
}

void Recovery::write(std::string_view text) {
    if (!enabled()) return;
    std::error_code ignored;
    if (lock_.held() && !fs::exists(lockOf(file_), ignored)) {
        lock_.release();  // somebody has emptied the folder
        kept_ = false;
    }
    if (!lock_.held()) {
        createFolders(folder_);
        for (int i = 0; i < 100 && !lock_.held(); ++i) {
            const auto now = std::chrono::system_clock::now().time_since_epoch();
            file_ = folder_ / fmt::format("view-{}-{}.json", getpid(), now.count());
            if (!fs::exists(file_, ignored)) lock_.take(lockOf(file_));
        }
        if (!lock_.held()) throwMachine("{}: no lock can be had there", folder_.string());
    }
    AtomicFile file(file_);
    file.write(text);
    file.commit();
    kept_ = true;
}

void Recovery::clear() {
    if (!lock_.held()) return;
    std::error_code ignored;
    fs::remove(file_, ignored);
    fs::remove(lockOf(file_), ignored);
    lock_.release();
    kept_ = false;
}

std::vector<Recovery::Orphan> Recovery::orphans() const {
    std::vector<std::pair<fs::file_time_type, fs::path>> files;
    std::error_code error;
    if (!enabled()) return {};
    for (fs::directory_iterator at(folder_, error), end; !error && at != end; at.increment(error)) {
        const fs::path& path = at->path();
        std::error_code ignored;
        if (path.extension() == ".json" && path.filename().string().starts_with("view-") &&
            path != file_ && fs::is_regular_file(path, ignored))
            files.emplace_back(fs::last_write_time(path, ignored), path);
    }
    std::ranges::sort(files, std::greater{});
    std::vector<Orphan> found;
    for (const auto& [time, path] : files) {
        Orphan orphan{path, {}, {}};
        if (!orphan.lock.take(lockOf(path))) continue;
        try {
            const std::vector<uint8_t> bytes = readWholeFile(path, kLargestFile);
            orphan.text.assign(bytes.begin(), bytes.end());
        } catch (const std::exception&) {
            continue;  // it went away in between
        }
        found.push_back(std::move(orphan));
    }
    return found;
}

void Recovery::remove(const Orphan& orphan) {
    std::error_code ignored;
    fs::remove(orphan.file, ignored);
    fs::remove(lockOf(orphan.file), ignored);
}

}  // namespace doppel
