#include "engine/files/byte_store.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>

#include "engine/error.h"

namespace doppel {

namespace {

// Large files that need not outlive a process; /tmp may be in memory.
std::string folder() {
    const char* set = std::getenv("TMPDIR");
    return set && *set ? set : "/var/tmp";
}

int nameless() {
    std::string name = folder() + "/doppel-XXXXXX";
    const int file = mkostemp(name.data(), O_CLOEXEC);
    if (file < 0)
        throwMachine(
            "{}: no file can be made for what memory does not hold (TMPDIR names another "
            "folder): {}",
            folder(), std::strerror(errno));
    unlink(name.c_str());
    return file;
}

}  // namespace

ByteStore::~ByteStore() {
    if (file_ >= 0) close(file_);
}

ByteStore::ByteStore(ByteStore&& other) noexcept
    : entries_(std::move(other.entries_)),
      budget_(other.budget_),
      inMemory_(other.inMemory_),
      inFile_(other.inFile_),
      file_(std::exchange(other.file_, -1)) {}

size_t ByteStore::add(std::span<const uint8_t> bytes) {
    Entry entry{.size = bytes.size()};
    if (inMemory_ + bytes.size() <= budget_) {
        entry.bytes.assign(bytes.begin(), bytes.end());
        inMemory_ += bytes.size();
    } else {
        if (file_ < 0) file_ = nameless();
        entry.place = inFile_;
        for (size_t done = 0; done < bytes.size();) {
            const ssize_t now = pwrite(file_, bytes.data() + done, bytes.size() - done,
                                       static_cast<off_t>(inFile_ + done));
            if (now < 0 && errno == EINTR) continue;
            if (now <= 0)
                throwMachine(
                    "{}: cannot take what memory does not hold (TMPDIR names another "
                    "folder): {}",
                    folder(), std::strerror(errno));
            done += static_cast<size_t>(now);
        }
        inFile_ += bytes.size();
    }
    entries_.push_back(std::move(entry));
    return entries_.size() - 1;
}

std::vector<uint8_t> ByteStore::read(size_t which) const {
    CHECK(which < entries_.size(), "{} is one of the {} byte strings kept", which, entries_.size());
    const Entry& entry = entries_[which];
    if (entry.bytes.size() == entry.size) return entry.bytes;
    std::vector<uint8_t> bytes(entry.size);
    for (size_t done = 0; done < bytes.size();) {
        const ssize_t now = pread(file_, bytes.data() + done, bytes.size() - done,
                                  static_cast<off_t>(entry.place + done));
        if (now < 0 && errno == EINTR) continue;
        if (now <= 0)
            throwMachine("{}: what was put away cannot be read: {}", folder(),
                         now < 0 ? std::strerror(errno) : "the file has ended");
        done += static_cast<size_t>(now);
    }
    return bytes;
}

}  // namespace doppel
