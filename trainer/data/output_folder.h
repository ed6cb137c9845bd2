// Folders that Doppel writes, such that nobody's files are lost: each holds a list of what Doppel
// wrote there (.doppel-files), and what is not on it is neither replaced nor removed.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace doppel {

// ---- names and places ---------------------------------------------------------------------------

// The one place where names that come from files are looked at before they become part of a path.
// InputError that starts with `where` unless it is the name of one visible file or folder: no
// separator, no dot first, no control character, not empty, and short enough that an extension and
// a temporary name's ending find room beside it.
void requireFileName(std::string_view name, std::string_view where);

// InputError where `out`, a folder or a file, is one of the inputs, lies in one or has one in it,
// after links are resolved. Inputs that are empty or not there do not count.
void requireApart(const std::filesystem::path& out,
                  const std::vector<std::filesystem::path>& inputs);
// The same for a file, which may lie in an input's folder, but must not be an input, nor a link to
// what is in one.
void requireFileApart(const std::filesystem::path& out,
                      const std::vector<std::filesystem::path>& inputs);

// mkdir -p with one clear error: InputError where a file is in the way, MachineError where the
// system refuses.
void createFolders(const std::filesystem::path& folder);

// Copies a file's bytes. InputError where the source cannot be read, MachineError where the target
// cannot be written.
void copyFile(const std::filesystem::path& from, const std::filesystem::path& to);

// ---- folders that grow --------------------------------------------------------------------------

// Makes the folder and puts these names of files and folders, about to be written into it, on its
// list. `kind` is what the folder is: "avatar". InputError, with nothing changed, where one of them
// is there and Doppel did not write it, or where the folder is of another kind.
void claimFiles(const std::filesystem::path& folder, std::string_view kind,
                const std::vector<std::string>& names);
// Takes the list away again, for a folder in which nothing was written.
void removeFileList(const std::filesystem::path& folder);

// Keeps a second run out of a folder. The system lets go of it when the process ends, however it
// does. Where the file system has no locks there is none.
class FolderLock {
public:
    // InputError where another run holds it.
    explicit FolderLock(const std::filesystem::path& folder);
    ~FolderLock();
    FolderLock(const FolderLock&) = delete;
    FolderLock& operator=(const FolderLock&) = delete;

private:
    int descriptor_ = -1;
};

// ---- folders that are replaced ------------------------------------------------------------------

// A folder being written under a temporary name beside its place. commit() renames it; without
// commit() the destructor deletes it and the place stays as it was. What a killed run has left
// there is deleted by the next run.
//
// A folder that is already there is replaced if it is empty, or of the same kind and with nothing
// in it but what Doppel wrote; anything else is an InputError that names a file in the way. So is
// another run that is writing to the same place. MachineError where the system refuses (no
// permission, no space).
//
// Long work goes on where it was: what a run of the same work has left there is taken on by the
// next.
class OutputFolder {
public:
    // kind: "capture", "render". work: all that the folder's content depends on, for what can go
    // on; empty for what cannot.
    OutputFolder(const std::filesystem::path& target, std::string kind, std::string_view work = {});
    ~OutputFolder();
    OutputFolder(const OutputFolder&) = delete;
    OutputFolder& operator=(const OutputFolder&) = delete;

    const std::filesystem::path& folder() const { return temporary_; }  // write here
    const std::filesystem::path& target() const { return target_; }
    // Whether a run of the same work has left something there.
    bool goesOn() const { return goesOn_; }
    // Leaves the folder to the next run of the same work, uncommitted; it has to be one that can go
    // on.
    void leave() noexcept;
    void commit();

private:
    void discard() noexcept;

    std::filesystem::path target_, temporary_;
    std::string kind_;
    int lock_ = -1;  // on the temporary folder: tells other runs that this one lives
    bool pending_ = false, goesOn_ = false;
};

// Whether a run that lives, this one too, is writing such a folder and has not committed it yet.
bool isFolderBeingWritten(const std::filesystem::path& target);

// Deletes such a folder, and what killed runs have left beside it; nothing where it is not ours.
void removeOutputFolder(const std::filesystem::path& target, std::string_view kind);

}  // namespace doppel
