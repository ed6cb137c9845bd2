// Folders that appear whole or not at all.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace doppel {

// A folder being written under a temporary name beside its place. commit() renames it; without
// commit() the destructor deletes it and the place stays as it was.
//
// A folder that is already there is replaced if it is empty or holds the file `marker`, by which we
// know our own ("capture.toml"); anything else is an InputError, so that nobody's files are lost.
// MachineError where the system refuses (no permission, no space).
class OutputFolder {
public:
    OutputFolder(const std::filesystem::path& target, std::string marker);
    ~OutputFolder();
    OutputFolder(const OutputFolder&) = delete;
    OutputFolder& operator=(const OutputFolder&) = delete;

    const std::filesystem::path& folder() const { return temporary_; }  // write here
    const std::filesystem::path& target() const { return target_; }
    void commit();

private:
    std::filesystem::path target_, temporary_;
    std::string marker_;
    bool pending_ = false;
};

// The one place where names that come from files are looked at before they become part of a path.
// InputError that starts with `where` unless it is the name of one visible file or folder: no
// separator, no dot first, no control character, not empty, and short enough that an extension and
// a temporary name's ending find room beside it.
void requireFileName(std::string_view name, std::string_view where);

// mkdir -p with one clear error: InputError where a file is in the way, MachineError where the
// system refuses.
void createFolders(const std::filesystem::path& folder);

// Copies a file's bytes. InputError where the source cannot be read, MachineError where the target
// cannot be written.
void copyFile(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace doppel
