// Random mouse, keys, drops and films, by a seed: the window lives, answers, and its undo stack
// stays whole.
#include <cstdio>
#include <random>
#include <set>

#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

int numberOf(const char* variable, int otherwise) {
    const char* text = getenv(variable);
    return text && *text ? std::max(1, atoi(text)) : otherwise;
}

class MonkeyTest : public InWorkFolder {
protected:
    void SetUp() override {
        InWorkFolder::SetUp();
        alarm(0);  // long runs are asked for
    }
    std::vector<fs::path> filesToDrop() {
        const Motion motion = turningMotion(12);
        writeNpz(*folder_ / "other.npz", posesArrays(motion.theta, motion.trans, motion.betas),
                 false);
        writeColouredCapture(*folder_ / "capture", turningMotion(8));
        Image image(40, 30, 3);
        writeImage(*folder_ / "black.png", image);
        std::ofstream(*folder_ / "pose.json")
            << R"({"doppel_pose": 1, "joints": {"left_wrist": [0.5, 0, -1]}})";
        std::ofstream(*folder_ / "nothing.txt") << "nothing";
        writeAvatar(*folder_ / "same shape", plainAvatar());
        std::vector<fs::path> files;
        for (const char* name : {"motion.npz", "other.npz", "capture", "black.png", "pose.json",
                                 "nothing.txt", "same shape", "nowhere"})
            files.push_back(*folder_ / name);
        return files;
    }
};

TEST_F(MonkeyTest, RandomEventsLeaveTheWindowAliveAndItsUndoWhole) {
    const int events = numberOf("DOPPEL_MONKEY", 300);
    const auto seed = static_cast<unsigned>(numberOf("DOPPEL_MONKEY_SEED", 1));
    std::mt19937 random(seed);
    const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };

    Motion motion = turningMotion(20);
    writeNpz(*folder_ / "motion.npz", posesArrays(motion.theta, motion.trans, {}), false);
    ViewerOptions options;
    options.motion = *folder_ / "motion.npz";
    options.state = *folder_ / "state";
    options.width = 700, options.height = 520;
    options.retarget.on = false;  // its first pose is the one from before it was opened
    Viewer& viewer = open(options);
    viewer.settings().panel = true;
    settle();
    const Take beginning = viewer.editor().take();

    // Files to drop, of the same shape as there is: undo does not bring another person's back.
    const std::vector<fs::path> files = filesToDrop();
    // Ctrl+F12 films, F12 and Ctrl+S write small files.
    const std::vector<std::string> keys = {
        "f", "Home",   "1",      "3",   "7",          "5", "0", "space", "Left", "Right",
        "m", "r",      "p",      "k",   "w",          "l", "j", "b",     "n",    "Tab",
        "h", "Escape", "Return", "F12", "KP_Decimal", "t", "g", "i"};
    const std::vector<std::string> controlled = {"z",     "y",     "c", "v",   "s",  "q",
                                                 "equal", "minus", "0", "F12", "F12"};
    std::set<int> held;
    uint64_t asked = 0;  // the editor's version when the window asked last
    int event = 0, drops = 0, films = 0;
    const auto oneTurn = [&] {
        const bool worked = viewer.working();
        // Somebody may have answered that the work, as it was then, is to be lost.
        if (!viewer.question().empty()) asked = viewer.editor().version();
        const bool lives = viewer.frame();
        films += !worked && viewer.working();
        if (lives) return;
        ASSERT_TRUE(asked == viewer.editor().version() || !viewer.editor().modified())
            << "seed " << seed << ", event " << event << ": the window closed over unsaved work";
        viewer.window().keepOpen();
    };
    for (; event < events && !HasFatalFailure(); ++event) {
        const int kind = below(100);
        if (kind < 45) {
            // Half of the moves go to joints, so that something happens.
            glm::dvec2 to(below(720) - 10, below(540) - 10);
            if (below(2)) to = at(static_cast<size_t>(below(24)));
            screen_->move(std::clamp(to.x, 0.0, 990.0), std::clamp(to.y, 0.0, 750.0));
        } else if (kind < 65) {
            const int button = 1 + below(3);
            if (!held.insert(button).second) {
                screen_->release(button);
                held.erase(button);
            } else {
                screen_->press(button);
            }
        } else if (kind < 68) {
            screen_->click(4 + below(4));
        } else if (kind < 74) {
            // A whole drag of a joint, which seldom comes about by itself.
            const glm::dvec2 from = at(static_cast<size_t>(below(24)));
            screen_->move(std::clamp(from.x, 0.0, 990.0), std::clamp(from.y, 0.0, 750.0));
            viewer.frame();
            screen_->press(1);
            viewer.frame();
            screen_->move(std::clamp(from.x + below(160) - 80, 0.0, 990.0),
                          std::clamp(from.y + below(160) - 80, 0.0, 750.0));
            viewer.frame();
            screen_->release(1);
            held.erase(1);
        } else if (kind < 88) {
            const bool shift = below(5) == 0;
            if (shift) screen_->keyDown("Shift_L");
            screen_->key(keys[static_cast<size_t>(below(static_cast<int>(keys.size())))]);
            if (shift) screen_->keyUp("Shift_L");
        } else if (kind < 95) {
            screen_->keyDown("Control_L");
            screen_->key(
                controlled[static_cast<size_t>(below(static_cast<int>(controlled.size())))]);
            screen_->keyUp("Control_L");
        } else if (kind < 96) {
            screen_->resizeWindow(250 + below(700), 180 + below(520));
        } else if (kind < 99) {
            std::vector<fs::path> dropped;
            for (int count = 1 + below(2); count > 0; --count)
                dropped.push_back(
                    files[static_cast<size_t>(below(static_cast<int>(files.size())))]);
            screen_->drop(uriList(dropped), below(200), below(150), oneTurn);
            ++drops;
        } else {
            viewer.editor().setBetas({static_cast<float>(below(5))});
        }
        for (int turns = below(3); turns >= 0; --turns) oneTurn();
        ASSERT_TRUE(isFinite(viewer.editor().pose())) << "seed " << seed << ", event " << event;
        for (const Keyframe& key : viewer.editor().keyframes()) ASSERT_TRUE(isFinite(key.pose));
    }
    for (int button : held) screen_->release(button);
    screen_->resizeWindow(700, 520);
    await("the films", [&] {
        viewer.window().keepOpen();
        viewer.frame();
        return !viewer.working();
    });
    // Whatever asks, films, or plays.
    for (int i = 0; i < 20 && (i < 3 || !viewer.settled()); ++i) {
        viewer.window().keepOpen();
        screen_->move(4, 4);
        screen_->key(i % 4 == 3 ? "space" : "Escape");
        for (int turns = 0; turns < 200 && (turns < 8 || !viewer.settled()); ++turns)
            viewer.frame();
    }
    settle();

    // Back to the beginning and on to the end again, to the last bit.
    PoseEditor& editor = viewer.editor();
    editor.endGesture();
    const Take end = editor.take();
    const double time = editor.time();
    size_t steps = 0;
    while (editor.canUndo()) editor.undo(), ++steps;
    EXPECT_LE(steps, 500u);
    if (steps < 500) {
        EXPECT_EQ(editor.take().keys, beginning.keys);
        EXPECT_EQ(editor.betas(), beginning.betas);
        editor.goTo(0);
        EXPECT_EQ(editor.pose(), beginning.pose);
    }
    for (size_t i = 0; i < steps; ++i) {
        ASSERT_TRUE(editor.canRedo());
        editor.redo();
    }
    editor.goTo(time);
    EXPECT_EQ(editor.take().keys, end.keys);
    EXPECT_EQ(editor.betas(), end.betas);
    EXPECT_EQ(editor.pose(), end.pose);
    settle();
    viewer.settings().panel = false;
    viewer.settings().joints = false;
    viewer.settings().backdrop = Backdrop::Colour;
    screen_->key("Home");
    settle();
    EXPECT_GT(shareOfAvatar(picture()), 0.02);
    fmt::print("{} events, {} drops, {} films, {} steps of undo\n", events, drops, films, steps);
}

}  // namespace
}  // namespace doppel::test
