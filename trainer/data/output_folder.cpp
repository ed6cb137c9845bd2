#include "trainer/data/output_folder.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <optional>
#include <set>
#include <system_error>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/printable.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

std::string systemMessage(int error) {
    return std::error_code(error, std::generic_category()).message();
}

// The folder itself where the path goes through links, without a slash at its end.
fs::path resolved(const fs::path& path) {
    std::error_code error;
    const fs::path absolute = fs::absolute(path).lexically_normal();
    fs::path result = fs::weakly_canonical(absolute, error);
    if (error) result = absolute;
    return result.has_filename() ? result : result.parent_path();
}

bool isSame(const fs::path& a, const fs::path& b) {
    std::error_code ignored;
    return a == b || fs::equivalent(a, b, ignored);
}

// Whether one of the folders above the path is this one.
bool liesIn(const fs::path& path, const fs::path& folder) {
    for (fs::path above = path; above != above.parent_path();) {
        above = above.parent_path();
        if (isSame(above, folder)) return true;
    }
    return false;
}

bool isThere(const fs::path& path) {
    std::error_code ignored;
    return fs::symlink_status(path, ignored).type() != fs::file_type::not_found;
}

// ---- the list -----------------------------------------------------------------------------------

constexpr const char* kListName = ".doppel-files";
constexpr std::string_view kListHead = "doppel: what it wrote into this folder, as ";

// First line: what the folder is. Then a line per file or folder, relative to it.
struct FileList {
    std::string kind;
    std::set<std::string> names;
};

std::optional<FileList> readFileList(const fs::path& folder) {
    const fs::path path = folder / kListName;
    std::error_code ignored;
    if (!fs::is_regular_file(fs::symlink_status(path, ignored))) return std::nullopt;
    const std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{64} << 20);
    std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    if (!text.starts_with(kListHead)) return std::nullopt;
    text.remove_prefix(kListHead.size());
    FileList list;
    for (bool first = true; !text.empty(); first = false) {
        const size_t end = std::min(text.find('\n'), text.size());
        if (first)
            list.kind = text.substr(0, end);
        else
            list.names.emplace(text.substr(0, end));
        text.remove_prefix(std::min(end + 1, text.size()));
    }
    return list;
}

void writeFileList(const fs::path& folder, const FileList& list) {
    std::string text = fmt::format("{}{}\n", kListHead, list.kind);
    for (const std::string& name : list.names) text += name + "\n";
    AtomicFile file(folder / kListName);
    file.write(text);
    file.commit();
}

// All that is in a folder, links not followed: files, and folders with a slash at the end.
std::set<std::string> contentsOf(const fs::path& folder) {
    std::set<std::string> names;
    std::error_code error;
    fs::recursive_directory_iterator entry(folder, error), end;
    for (; !error && entry != end; entry.increment(error)) {
        const std::string name = entry->path().lexically_relative(folder).string();
        names.insert(fs::is_directory(entry->symlink_status()) ? name + "/" : name);
    }
    if (error) throwMachine("{}: cannot be looked at: {}", folder.string(), error.message());
    names.erase(kListName);
    return names;
}

// Something in a folder that Doppel did not write as this kind; empty: there is nothing.
std::string foreignIn(const fs::path& folder, std::string_view kind) {
    const std::set<std::string> there = contentsOf(folder);
    const std::optional<FileList> list = readFileList(folder);
    if (!list) return there.empty() ? std::string() : *there.begin();
    if (list->kind != kind) return fmt::format("what Doppel wrote as {}", list->kind);
    for (const std::string& name : there)
        if (!list->names.contains(name)) return name;
    return {};
}

// InputError where committing to this place would lose somebody's files.
void requireReplaceable(const fs::path& target, std::string_view kind) {
    std::error_code error;
    const fs::file_status status = fs::status(target, error);
    if (!fs::exists(status)) {
        if (!isThere(target)) return;
        throwInput("{}: expected a folder or nothing, found a link to nothing; name another place",
                   target.string());
    }
    if (!fs::is_directory(status)) {
        throwInput("{}: expected a folder or nothing, found a file; name another place",
                   target.string());
    }
    const std::string foreign = foreignIn(target, kind);
    if (foreign.empty()) return;
    throwInput(
        "{}: expected an empty folder or one that Doppel wrote as {}, which would be replaced; "
        "found {}: name another place",
        target.string(), kind, printable(foreign));
}

// ---- locks --------------------------------------------------------------------------------------

enum class Lock : uint8_t { mine, anothers, none };

// Locks a folder until the descriptor is closed. None: not there, or the file system has no locks.
Lock lockFolder(const fs::path& folder, int& descriptor) {
    descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (descriptor < 0) return Lock::none;
    if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
        const Lock result = errno == EWOULDBLOCK ? Lock::anothers : Lock::none;
        ::close(std::exchange(descriptor, -1));
        return result;
    }
    // Whoever had it may have renamed or deleted it meanwhile.
    struct stat held {
    }, there{};
    if (::fstat(descriptor, &held) == 0 && ::lstat(folder.c_str(), &there) == 0 &&
        held.st_dev == there.st_dev && held.st_ino == there.st_ino)
        return Lock::mine;
    ::close(std::exchange(descriptor, -1));
    return Lock::none;
}

std::string temporaryStart(const fs::path& target) {
    return fmt::format(".{}.doppel-", target.filename().string());
}

// Folders beside a place that were made to become it.
std::vector<fs::path> temporaryFolders(const fs::path& target) {
    const std::string start = temporaryStart(target);
    constexpr size_t kRandom = 6;  // letters that mkdtemp fills in
    std::vector<fs::path> found;
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(target.parent_path(), ignored)) {
        const std::string name = entry.path().filename().string();
        if (name.starts_with(start) && name.size() == start.size() + kRandom)
            found.push_back(entry.path());
    }
    return found;
}

constexpr const char* kWorkName = ".doppel-work";  // what a folder that can go on is of

bool isOfWork(const fs::path& folder, std::string_view kind, std::string_view work) {
    const fs::path file = folder / kWorkName;
    std::error_code ignored;
    if (work.empty() || !fs::is_regular_file(fs::symlink_status(file, ignored))) return false;
    const std::optional<FileList> list = readFileList(folder);
    if (!list || list->kind != kind) return false;
    const std::vector<uint8_t> bytes = readFileHead(file, work.size() + 1);
    return std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()) == work;
}

struct LeftFolder {
    fs::path path;
    int lock = -1;  // held
};

// Deletes what killed runs have left beside a place, but for a folder of this work and kind, which
// is returned; InputError where a run that lives is writing to it.
std::optional<LeftFolder> removeLeftFolders(const fs::path& target, std::string_view kind = {},
                                            std::string_view work = {}) {
    std::optional<LeftFolder> left;
    std::error_code ignored;
    for (const fs::path& path : temporaryFolders(target)) {
        int descriptor = -1;
        const Lock lock = lockFolder(path, descriptor);
        if (lock == Lock::anothers) {
            if (left) ::close(left->lock);
            throwInput(
                "{}: another run of Doppel is writing it; wait for it, or name another place",
                target.string());
        }
        if (lock != Lock::mine) continue;
        if (!left && isOfWork(path, kind, work)) {
            left = {path, descriptor};
            continue;
        }
        if (readFileList(path))
            fs::remove_all(path, ignored);
        else
            fs::remove(path, ignored);  // unless there is something in it
        ::close(descriptor);
    }
    return left;
}

}  // namespace

// ---- names and places ---------------------------------------------------------------------------

void requireFileName(std::string_view name, std::string_view where) {
    constexpr size_t kLongest = 200;  // of the 255 bytes that file systems take
    const bool plain = std::ranges::none_of(
        name, [](unsigned char c) { return c == '/' || c == '\\' || c < 0x20 || c == 0x7f; });
    if (!name.empty() && !name.starts_with('.') && plain && name.size() <= kLongest) return;
    throwInput(
        "{}: expected a name without folder, of {} bytes at most, with no dot first and no control "
        "characters, found \"{}\"",
        where, kLongest, printable(name));
}

void requireApart(const fs::path& out, const std::vector<fs::path>& inputs) {
    if (out.empty()) return;
    const fs::path place = resolved(out);
    std::error_code ignored;
    for (const fs::path& input : inputs) {
        if (input.empty() || !fs::exists(input, ignored)) continue;
        const fs::path source = resolved(input);
        const char* found = isSame(place, source)   ? "the input itself"
                            : liesIn(place, source) ? "a place inside the input"
                            : liesIn(source, place) ? "a folder with the input in it"
                                                    : nullptr;
        if (found) {
            throwInput("{}: expected a place apart from the input {}, found {}; name another",
                       out.string(), input.string(), found);
        }
    }
}

void requireFileApart(const fs::path& out, const std::vector<fs::path>& inputs) {
    const fs::path place = resolved(out);
    std::error_code ignored;
    for (const fs::path& input : inputs) {
        if (input.empty() || !fs::exists(input, ignored)) continue;
        const fs::path source = resolved(input);
        if (isSame(place, source) || (fs::is_symlink(out, ignored) && liesIn(place, source))) {
            throwInput(
                "{}: expected a file apart from the input {}, found a part of it; name "
                "another",
                out.string(), input.string());
        }
    }
}

void createFolders(const fs::path& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (!error && fs::is_directory(folder, error)) return;
    if (!error || error == std::errc::not_a_directory || error == std::errc::file_exists) {
        throwInput("{}: expected a folder or nothing, found a file in the way; name another place",
                   folder.string());
    }
    throwMachine("{}: the folder cannot be made: {}", folder.string(), error.message());
}

void copyFile(const fs::path& from, const fs::path& to) {
    std::error_code error;
    if (!fs::is_regular_file(from, error)) {
        throwInput("{}: expected a file, found {}", from.string(),
                   fs::exists(from, error) ? "something else" : "nothing");
    }
    if (access(from.c_str(), R_OK) != 0) {
        throwInput("{}: cannot be read: {}", from.string(), systemMessage(errno));
    }
    fs::copy_file(from, to, fs::copy_options::overwrite_existing, error);
    if (error) throwMachine("{}: cannot be written: {}", to.string(), error.message());
    // A copy of a read-only file is still the user's own.
    fs::permissions(to, fs::perms::owner_write, fs::perm_options::add, error);
}

// ---- folders that grow --------------------------------------------------------------------------

void claimFiles(const fs::path& folder, std::string_view kind,
                const std::vector<std::string>& names) {
    createFolders(folder);
    const std::optional<FileList> there = readFileList(folder);
    if (there && there->kind != kind) {
        throwInput(
            "{}: expected a folder for {}, found what Doppel wrote as {}; name another place",
            folder.string(), kind, there->kind);
    }
    FileList list = there.value_or(FileList{std::string(kind), {}});
    for (const std::string& name : names) {
        const bool added = list.names.insert(name).second;
        if (added && isThere(folder / name)) {
            throwInput(
                "{}: expected nothing, or what Doppel wrote, found something else, which would be "
                "lost; name another folder",
                (folder / name).string());
        }
    }
    if (!there || there->names != list.names) writeFileList(folder, list);
}

void removeFileList(const fs::path& folder) {
    std::error_code ignored;
    if (readFileList(folder)) fs::remove(folder / kListName, ignored);
}

FolderLock::FolderLock(const fs::path& folder) {
    if (lockFolder(resolved(folder), descriptor_) != Lock::anothers) return;
    throwInput("{}: another run of Doppel is at work in it; wait for it, or name another place",
               folder.string());
}

FolderLock::~FolderLock() {
    if (descriptor_ >= 0) ::close(descriptor_);
}

// ---- folders that are replaced ------------------------------------------------------------------

OutputFolder::OutputFolder(const fs::path& target, std::string kind, std::string_view work)
    : target_(resolved(target)), kind_(std::move(kind)) {
    if (target.empty() || !target_.has_filename()) {
        throwInput("\"{}\": expected the name of a folder to write", target.string());
    }
    requireReplaceable(target_, kind_);
    createFolders(target_.parent_path());
    if (const auto left = removeLeftFolders(target_, kind_, work)) {
        temporary_ = left->path, lock_ = left->lock;
        pending_ = goesOn_ = true;
        return;
    }
    while (lock_ < 0) {
        std::string name = (target_.parent_path() / temporaryStart(target_)).string() + "XXXXXX";
        if (mkdtemp(name.data()) == nullptr) {
            throwMachine("{}: cannot be written: {}", target_.string(), systemMessage(errno));
        }
        temporary_ = name;
        // Another run that begins just now may have taken it for a leftover.
        if (lockFolder(temporary_, lock_) == Lock::none && isThere(temporary_)) break;
    }
    pending_ = true;
    // mkdtemp makes it private; it shall be as any other folder.
    const mode_t mask = umask(0);
    umask(mask);
    chmod(temporary_.c_str(), static_cast<mode_t>(0777 & ~mask));
    try {
        writeFileList(temporary_, {kind_, {}});
        if (!work.empty()) {
            AtomicFile file(temporary_ / kWorkName);
            file.write(work);
            file.commit();
        }
    } catch (...) {
        discard();
        throw;
    }
}

OutputFolder::~OutputFolder() { discard(); }

void OutputFolder::discard() noexcept {
    std::error_code ignored;
    if (std::exchange(pending_, false)) fs::remove_all(temporary_, ignored);
    if (lock_ >= 0) ::close(std::exchange(lock_, -1));
}

void OutputFolder::leave() noexcept {
    pending_ = false;
    discard();
}

void OutputFolder::commit() {
    CHECK(pending_, "an output folder is committed once");
    std::error_code error, ignored;
    fs::remove(temporary_ / kWorkName, ignored);
    writeFileList(temporary_, {kind_, contentsOf(temporary_)});
    requireReplaceable(target_, kind_);
    // With what is there in one step, where the system can.
    if (fs::exists(target_, ignored) && ::renameat2(AT_FDCWD, temporary_.c_str(), AT_FDCWD,
                                                    target_.c_str(), RENAME_EXCHANGE) == 0) {
        discard();  // what was there
        return;
    }
    const fs::path old = temporary_.string() + ".old";
    const bool replaces = fs::exists(target_, ignored);
    if (replaces) {
        fs::rename(target_, old, error);
        if (error) {
            throwMachine("{}: cannot be replaced: {}", target_.string(), error.message());
        }
    }
    fs::rename(temporary_, target_, error);
    if (error) {
        if (replaces) fs::rename(old, target_, ignored);
        throwMachine("{}: cannot be written: {}", target_.string(), error.message());
    }
    pending_ = false;
    discard();
    if (replaces) fs::remove_all(old, ignored);
}

bool isFolderBeingWritten(const fs::path& target) {
    for (const fs::path& path : temporaryFolders(resolved(target))) {
        int descriptor = -1;
        const Lock lock = lockFolder(path, descriptor);
        if (descriptor >= 0) ::close(descriptor);
        if (lock == Lock::anothers) return true;
    }
    return false;
}

void removeOutputFolder(const fs::path& target, std::string_view kind) {
    const fs::path place = resolved(target);
    std::error_code ignored;
    if (!fs::is_directory(place.parent_path(), ignored)) return;
    removeLeftFolders(place);
    if (fs::is_directory(place, ignored) && foreignIn(place, kind).empty())
        fs::remove_all(place, ignored);
}

}  // namespace doppel
