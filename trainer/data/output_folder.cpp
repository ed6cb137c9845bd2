#include "trainer/data/output_folder.h"

#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <system_error>

#include "engine/error.h"
#include "engine/printable.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// The folder itself where the path goes through links, without a slash at its end.
fs::path resolved(const fs::path& path) {
    std::error_code error;
    const fs::path absolute = fs::absolute(path).lexically_normal();
    fs::path result = fs::weakly_canonical(absolute, error);
    if (error) result = absolute;
    return result.has_filename() ? result : result.parent_path();
}

}  // namespace

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
        throwInput("{}: cannot be read: {}", from.string(),
                   std::error_code(errno, std::generic_category()).message());
    }
    fs::copy_file(from, to, fs::copy_options::overwrite_existing, error);
    if (error) throwMachine("{}: cannot be written: {}", to.string(), error.message());
    // A copy of a read-only file is still the user's own.
    fs::permissions(to, fs::perms::owner_write, fs::perm_options::add, error);
}

OutputFolder::OutputFolder(const fs::path& target, std::string marker)
    : target_(resolved(target)), marker_(std::move(marker)) {
    std::error_code error;
    if (target.empty() || !target_.has_filename()) {
        throwInput("\"{}\": expected the name of a folder to write", target.string());
    }
    const fs::file_status status = fs::status(target_, error);
    if (fs::exists(status)) {
        if (!fs::is_directory(status)) {
            throwInput("{}: expected a folder or nothing, found a file; name another place",
                       target_.string());
        }
        const bool empty = fs::is_empty(target_, error);
        if (error) throwMachine("{}: cannot be looked at: {}", target_.string(), error.message());
        if (!empty && !fs::exists(target_ / marker_, error)) {
            throwInput(
                "{}: expected an empty folder or one with {}, which would be replaced; found "
                "other files: name another place",
                target_.string(), marker_);
        }
    }
    createFolders(target_.parent_path());
    std::string name =
        (target_.parent_path() / fmt::format(".{}.XXXXXX", target_.filename().string())).string();
    if (mkdtemp(name.data()) == nullptr) {
        throwMachine("{}: cannot be written: {}", target_.string(),
                     std::error_code(errno, std::generic_category()).message());
    }
    temporary_ = name;
    pending_ = true;
    // mkdtemp makes it private; it shall be as any other folder.
    const mode_t mask = umask(0);
    umask(mask);
    chmod(temporary_.c_str(), static_cast<mode_t>(0777 & ~mask));
}

OutputFolder::~OutputFolder() {
    std::error_code ignored;
    if (pending_) fs::remove_all(temporary_, ignored);
}

void OutputFolder::commit() {
    CHECK(pending_, "an output folder is committed once");
    std::error_code error, ignored;
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
    if (replaces) fs::remove_all(old, ignored);
}

}  // namespace doppel
