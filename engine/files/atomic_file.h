// Files that appear whole or not at all: written under a temporary name in the target's folder,
// flushed to the disk and renamed over the target in one step.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace doppel {

// One file being written. Without commit() the destructor deletes the temporary file and the target
// stays as it was. What a killed process has left is deleted by the next one that writes there.
//
//     AtomicFile file("out/points.bin");
//     file.write(points.data(), points.size() * sizeof(float));
//     file.commit();
//
// Errors: MachineError where the system refuses (no permission, no space); InputError where the
// target cannot be a file (its folder is missing, it is a folder or a device). Both name the
// target.
class AtomicFile {
public:
    explicit AtomicFile(std::filesystem::path target);
    ~AtomicFile();
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    // Appends `size` bytes.
    void write(const void* data, size_t size);
    void write(std::string_view text) { write(text.data(), text.size()); }

    // For libraries that open files by name: the temporary name, which keeps the target's
    // extension. Afterwards the library writes, not write().
    const std::filesystem::path& pathForLibrary();

    // Flush, rename. The library that got pathForLibrary() has closed the file by then.
    void commit();

    const std::filesystem::path& target() const { return target_; }

private:
    [[noreturn]] void fail(const char* doing, int error) const;
    void closeDescriptor() noexcept;
    void forget() noexcept;  // the temporary file is gone

    std::filesystem::path target_, temporary_;
    int descriptor_ = -1, lock_ = -1;  // the lock tells other writers that this one lives
    bool pending_ = false;             // a temporary file exists
    int slot_ = -1;                    // where removeTemporaryFiles() finds its name
};

// Deletes temporary files of this target that killed processes have left, as every writer of it
// does when it begins; never those of one that lives.
void removeLeftovers(const std::filesystem::path& target) noexcept;

// Whether somebody who lives, this process too, is writing it and has not committed yet.
bool isBeingWritten(const std::filesystem::path& target) noexcept;

// Deletes the temporary files of this process that are not committed yet: for a signal handler that
// ends the process, where no destructor runs (async-signal-safe).
void removeTemporaryFiles() noexcept;

// The whole file at once. InputError names the file: missing, unreadable, not a regular file, or
// larger than `limit` bytes.
std::vector<uint8_t> readWholeFile(const std::filesystem::path& path,
                                   uint64_t limit = uint64_t{16} << 30);

// The first bytes only, at most `size`; the same errors.
std::vector<uint8_t> readFileHead(const std::filesystem::path& path, size_t size);

// write + commit in one call.
void writeWholeFile(const std::filesystem::path& path, std::span<const uint8_t> bytes);

}  // namespace doppel
