#include "engine/files/atomic_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <limits>
#include <utility>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr size_t kMaxChunk = size_t{1} << 30;  // Linux moves at most 2 GiB in one call

// Names of files in the making. A handler may run at any instant, so a slot's name is complete
// before `ready` says so. Beyond this many open at once, an interrupt leaves a hidden file behind.
struct Slot {
    std::atomic<bool> taken{false}, ready{false};
    char name[1024];
};
Slot gSlots[32];

int takeSlot(const std::string& name) {
    if (name.size() >= sizeof(Slot::name)) return -1;
    for (size_t i = 0; i < std::size(gSlots); ++i) {
        if (gSlots[i].taken.exchange(true)) continue;
        std::memcpy(gSlots[i].name, name.c_str(), name.size() + 1);
        gSlots[i].ready = true;
        return static_cast<int>(i);
    }
    return -1;
}

// Of a target that several write at once, each has another.
constexpr int kAtOnce = 32;

fs::path temporaryName(const fs::path& target, int number) {
    const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
    return folder / fmt::format(".{}.doppel-tmp-{}{}", target.stem().string(), number,
                                target.extension().string());
}

// Whether the descriptor's file is the one that has this name now.
bool isNamed(int descriptor, const fs::path& path) {
    struct stat held {
    }, there{};
    return ::fstat(descriptor, &held) == 0 && ::lstat(path.c_str(), &there) == 0 &&
           held.st_dev == there.st_dev && held.st_ino == there.st_ino;
}

}  // namespace

void removeLeftovers(const fs::path& target) noexcept {
    for (int number = 0; number < kAtOnce; ++number) {
        const fs::path path = temporaryName(target, number);
        const int descriptor = ::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK);
        if (descriptor < 0) continue;
        if (::flock(descriptor, LOCK_EX | LOCK_NB) == 0 && isNamed(descriptor, path))
            ::unlink(path.c_str());
        ::close(descriptor);
    }
}

bool isBeingWritten(const fs::path& target) noexcept {
    bool lives = false;
    for (int number = 0; number < kAtOnce && !lives; ++number) {
        const int descriptor = ::open(temporaryName(target, number).c_str(),
                                      O_RDONLY | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK);
        if (descriptor < 0) continue;
        lives = ::flock(descriptor, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
        ::close(descriptor);
    }
    return lives;
}

void removeTemporaryFiles() noexcept {
    for (Slot& slot : gSlots) {
        if (slot.ready) ::unlink(slot.name);
    }
}

void AtomicFile::forget() noexcept {
    pending_ = false;
    if (lock_ >= 0) ::close(std::exchange(lock_, -1));
    if (slot_ < 0) return;
    gSlots[slot_].ready = false;
    gSlots[slot_].taken = false;
    slot_ = -1;
}

AtomicFile::AtomicFile(fs::path target) : target_(std::move(target)) {
    std::error_code ignored;
    // A link stays a link: the file that it points to is replaced.
    if (fs::is_symlink(target_, ignored)) {
        const fs::path resolved = fs::weakly_canonical(target_, ignored);
        if (!ignored) target_ = resolved;
    }
    const fs::file_status status = fs::status(target_, ignored);
    if (fs::is_directory(status)) {
        throwInput("{}: is a folder; expected the name of a file to write", target_.string());
    }
    if (fs::exists(status) && !fs::is_regular_file(status)) {
        throwInput("{}: is not a regular file; give another name to write to", target_.string());
    }
    if (target_.filename().empty()) {
        throwInput("'{}': expected the name of a file to write", target_.string());
    }
    const fs::path folder = target_.has_parent_path() ? target_.parent_path() : fs::path(".");
    if (!fs::is_directory(folder, ignored)) {
        throwInput("{}: its folder {} does not exist; make it first", target_.string(),
                   folder.string());
    }

    removeLeftovers(target_);
    int error = EEXIST;
    for (int number = 0; number < kAtOnce && error == EEXIST; ++number) {
        temporary_ = temporaryName(target_, number);
        descriptor_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (descriptor_ < 0) {
            error = errno;
            continue;
        }
        // Another writer that begins just now may take it for a leftover. Where the file system
        // has no locks nobody does.
        const bool taken = ::flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
        if (taken || !isNamed(descriptor_, temporary_)) {
            closeDescriptor();
            continue;
        }
        lock_ = ::fcntl(descriptor_, F_DUPFD_CLOEXEC, 0);
        pending_ = true;
        slot_ = takeSlot(fs::absolute(temporary_, ignored).string());
        return;
    }
    fail("create", error);
}

AtomicFile::~AtomicFile() {
    closeDescriptor();
    if (pending_) ::unlink(temporary_.c_str());
    forget();
}

void AtomicFile::closeDescriptor() noexcept {
    if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
}

void AtomicFile::fail(const char* doing, int error) const {
    throwMachine("{}: cannot {} it: {}", target_.string(), doing, std::strerror(error));
}

void AtomicFile::write(const void* data, size_t size) {
    CHECK(descriptor_ >= 0, "{} must be open for write()", target_.string());
    const char* bytes = static_cast<const char*>(data);
    while (size > 0) {
        const ssize_t written = ::write(descriptor_, bytes, std::min(size, kMaxChunk));
        if (written < 0) {
            if (errno == EINTR) continue;
            fail("write", errno);
        }
        bytes += written;
        size -= static_cast<size_t>(written);
    }
}

const fs::path& AtomicFile::pathForLibrary() {
    closeDescriptor();
    return temporary_;
}

void AtomicFile::commit() {
    CHECK(pending_, "{} must be committed once", target_.string());
    if (descriptor_ < 0) {
        descriptor_ = ::open(temporary_.c_str(), O_WRONLY | O_CLOEXEC);
        if (descriptor_ < 0) fail("write", errno);
    }
    // Without the flush a power cut after the rename could leave an empty file under the name.
    // EINVAL: the file system has no such thing.
    if (::fsync(descriptor_) != 0 && errno != EINVAL) fail("write", errno);
    if (::close(std::exchange(descriptor_, -1)) != 0 && errno != EINTR) fail("write", errno);
    if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail("rename", errno);
    forget();
}

namespace {

// `wanted` bytes from the start, or all of them.
std::vector<uint8_t> readFile(const fs::path& path, uint64_t limit, uint64_t wanted) {
    // O_NONBLOCK: opening a pipe without a writer must not hang; it is refused just below.
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (descriptor < 0) throwInput("{}: cannot read it: {}", path.string(), std::strerror(errno));
    struct Closer {
        int descriptor;
        ~Closer() { ::close(descriptor); }
    } closer{descriptor};

    struct stat info {};
    if (::fstat(descriptor, &info) != 0) {
        throwInput("{}: cannot read it: {}", path.string(), std::strerror(errno));
    }
    if (S_ISDIR(info.st_mode)) throwInput("{}: is a folder; expected a file", path.string());
    if (!S_ISREG(info.st_mode)) throwInput("{}: is not a regular file", path.string());
    const uint64_t size = static_cast<uint64_t>(info.st_size);
    if (size > limit) {
        throwInput("{}: {} bytes; expected at most {}", path.string(), size, limit);
    }
    std::vector<uint8_t> bytes(std::min(size, wanted));
    size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t got =
            ::read(descriptor, bytes.data() + done, std::min(bytes.size() - done, kMaxChunk));
        if (got < 0) {
            if (errno == EINTR) continue;
            throwInput("{}: cannot read it: {}", path.string(), std::strerror(errno));
        }
        if (got == 0)
            break;  // it shrank while we read: the format's own checks will say what lacks
        done += static_cast<size_t>(got);
    }
    bytes.resize(done);
    return bytes;
}

}  // namespace

std::vector<uint8_t> readWholeFile(const fs::path& path, uint64_t limit) {
    return readFile(path, limit, limit);
}

std::vector<uint8_t> readFileHead(const fs::path& path, size_t size) {
    return readFile(path, std::numeric_limits<uint64_t>::max(), size);
}

void writeWholeFile(const fs::path& path, std::span<const uint8_t> bytes) {
    AtomicFile file(path);
    file.write(bytes.data(), bytes.size());
    file.commit();
}

}  // namespace doppel
