// The desktop's own dialog for a file's name: zenity's or kdialog's, as a process beside ours, so
// that the window goes on meanwhile.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "viewer/window/process.h"

namespace doppel {

class FileDialog {
public:
    enum class Asks { File, Folder, NewFile };

    // Whether one of these programs is in $PATH.
    static bool isThere();

    FileDialog() = default;
    ~FileDialog();
    FileDialog(const FileDialog&) = delete;
    FileDialog& operator=(const FileDialog&) = delete;

    // Shows one, in the place of another that is open. start: the folder, or the name that is
    // proposed. MachineError where it cannot be started.
    void open(Asks asks, const std::string& title, const std::filesystem::path& start);
    bool isOpen() const { return process_.running(); }
    // The name that was chosen, once: nothing while it is open, or where it was closed without one.
    std::optional<std::filesystem::path> chosen();

private:
    void end();

    Process process_;
    std::string answer_;
};

}  // namespace doppel
