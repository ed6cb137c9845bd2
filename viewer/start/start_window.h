// The window where there is no avatar yet: one is opened in it, or made of a clip.
#pragma once

#include <array>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/io/image.h"
#include "viewer/live/making.h"
#include "viewer/preferences.h"
#include "viewer/question.h"
#include "viewer/settings.h"
#include "viewer/window/canvas.h"
#include "viewer/window/file_dialog.h"
#include "viewer/window/window.h"

namespace doppel {

class StartWindow {
public:
    // For the viewer that is to come, whose avatar is still to be chosen: what it names instead, a
    // clip or a folder of pictures, is asked about as if it had been dropped. MachineError where no
    // window can be opened.
    explicit StartWindow(const ViewerOptions& options);

    // One turn, as Viewer::frame(): false once the window is closed, or an avatar is chosen and the
    // window says that it is being opened.
    bool frame();
    // Nothing: the window was closed.
    const std::optional<std::filesystem::path>& chosen() const { return chosen_; }
    // What still makes an avatar, for who shows it. This and takeWindow() are the last that it
    // does.
    std::optional<Making> takeMaking() { return std::exchange(making_, std::nullopt); }
    // In which the avatar is to be seen; what else was dropped on it is there again to be taken.
    std::unique_ptr<Window> takeWindow();

    Window& window() { return *window_; }
    const QuestionBox& question() const { return question_; }
    void answer(const std::string& label);
    const std::optional<Making>& making() const { return making_; }
    // The latest; empty: none.
    const std::string& message() const { return message_; }

private:
    // An avatar that was opened before.
    struct Known {
        std::filesystem::path folder;
        Image preview;           // empty: it has none
        CanvasImage shown = {};  // in the size that it is drawn in
    };

    void draw();
    void drawOpening();
    void drawDropPlace();
    void drawMaking();
    void drawKnown();
    void drawCard(Known& known, float side);
    void open(const std::filesystem::path& path);
    void openDropped();
    void choose(const std::filesystem::path& avatar);
    void advanceMaking();
    void askToLeave();
    void askForFile(FileDialog::Asks asks, const char* title);
    void attempt(const std::function<void()>& action);
    void say(std::string text, bool wrong);

    ViewerOptions options_;
    Preferences preferences_;
    std::unique_ptr<Window> window_;
    std::vector<Known> known_;
    QuestionBox question_;
    std::optional<Making> making_;
    FileDialog dialog_;
    std::deque<std::filesystem::path> dropped_;  // that wait for the answer to a question
    std::array<char, 512> pathText_{};
    std::string message_;
    bool wrong_ = false;  // of the message
    int framesToDraw_ = 3;
    std::optional<std::filesystem::path> chosen_;
};

}  // namespace doppel
