// An avatar that is made of a clip by `doppel avatar`, beside the window.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "viewer/question.h"
#include "viewer/window/process.h"

namespace doppel {

class Making {
public:
    // Whether the program makes avatars of such a thing: a film, or a folder of pictures that is no
    // capture.
    static bool takes(const std::filesystem::path& clip);
    // Where an avatar of it goes: beside it, clip-avatar of clip.mp4.
    static std::filesystem::path folderOf(const std::filesystem::path& clip);

    // program: the `doppel` that does it; empty: this one. On the device of this name; empty: the
    // best one. Goes on where the folder has what was begun of the same clip; what it says is in
    // log.txt there. InputError where that file is somebody else's, MachineError where it cannot be
    // started.
    Making(const std::filesystem::path& program, std::filesystem::path clip,
           const std::string& device);

    const std::filesystem::path& clip() const { return clip_; }
    std::filesystem::path avatar() const { return folderOf(clip_) / "avatar"; }
    // Listens to the program. Whether its line is another one, or it has ended.
    bool update();
    // What it said last: how far it is, or why it ended.
    const std::string& line() const { return line_; }
    // The same without a stage's losses, which the window shows elsewhere.
    std::string brief() const;
    // How much of what the line names is done, 0 to 1; nothing where it counts nothing.
    std::optional<double> share() const;
    // Its exit status, once it has ended.
    const std::optional<int>& status() const { return status_; }
    // Once it has: how. InputError with its own words where it went wrong by itself.
    std::string ending() const;
    // As Ctrl-C does: it keeps what it has done.
    void stop();
    bool stops() const { return stops_; }

private:
    std::filesystem::path clip_;
    Process process_;
    std::string unread_, line_;
    std::optional<int> status_;
    bool stops_ = false;
};

// Before one is begun, and before a window closes that watches one. What is to be done then is the
// window's to do.
Question questionToMake(const std::filesystem::path& clip, std::function<void()> make);
Question questionToLeave(const Making& making, std::function<void()> stopAndClose,
                         std::function<void()> close);

}  // namespace doppel
