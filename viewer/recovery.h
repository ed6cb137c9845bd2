// What a viewer that is killed leaves: the session that it had, in a file that the next one finds.
//
// Each viewer has a file of its own in the user's state folder and holds a lock beside it; the
// system lets the lock go when the process ends, however it ends. A file without a holder is one
// that nobody saved.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace doppel {

// $XDG_STATE_HOME/doppel, else $HOME/.local/state/doppel; empty where neither is set.
std::filesystem::path userStateFolder();

// A file by a name that another process, started elsewhere, knows it by.
std::string absolutePath(const std::filesystem::path& path);

// A lock that ends with the object or the process.
class FileLock {
public:
    FileLock() = default;
    ~FileLock() { release(); }
    FileLock(FileLock&& other) noexcept : descriptor_(other.descriptor_) { other.descriptor_ = -1; }
    FileLock& operator=(FileLock&& other) noexcept;

    // Nobody else holds it: makes the file, and the object holds it.
    bool take(const std::filesystem::path& path);
    bool held() const { return descriptor_ >= 0; }
    void release();

private:
    int descriptor_ = -1;
};

class Recovery {
public:
    // In a folder below `state`, which is made when there is something to keep; empty: keeps
    // nothing. What killed viewers left half written there is removed.
    explicit Recovery(const std::filesystem::path& state);
    // Leaves the file where there is one: whoever ends without having saved finds it again.
    ~Recovery() = default;

    // The text of this session, in the place of what it wrote before. MachineError where that
    // cannot be written.
    void write(std::string_view text);
    // There is nothing that is not saved.
    void clear();
    // Whether there is a text of this session.
    bool kept() const { return kept_; }
    const std::filesystem::path& file() const { return file_; }
    bool enabled() const { return !folder_.empty(); }

    // A file that a viewer has left and nobody holds; it is held as long as the object lives.
    struct Orphan {
        std::filesystem::path file;
        std::string text;
        FileLock lock;
    };
    // The newest first.
    std::vector<Orphan> orphans() const;
    static void remove(const Orphan& orphan);

private:
    std::filesystem::path folder_, file_;
    FileLock lock_;
    bool kept_ = false;
};

}  // namespace doppel
