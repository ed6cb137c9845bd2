// Nothing that was edited is lost: keys over a motion, undo, saving, closing, and a killed window.
#include <sys/wait.h>

#include "engine/files/atomic_file.h"
#include "tests/viewer_test.h"
#include "trainer/data/output_folder.h"

namespace doppel::test {
namespace {

class EditsTest : public InWorkFolder {
protected:
    void TearDown() override {
        viewer_.reset();
        fs::remove_all(*folder_ / "state");
        InWorkFolder::TearDown();
    }
    Viewer& openMotion(size_t frames = 30) {
        Motion motion = turningMotion(frames);
        fs::path poses = *folder_ / "motion.npz";
        writeNpz(poses, posesArrays(motion.theta, motion.trans, {}), false);
        ViewerOptions options;
        options.motion = poses;
        return open(options);
    }
    void press(const std::string& key, int times = 1) {
        for (int i = 0; i < times; ++i) {
            screen_->key(key);
            turn(2);
        }
        settle();
    }
    // Lifts the left wrist by so many pixels.
    void lift(double pixels) {
        glm::dvec2 from = at(joint::kLeftWrist);
        drag(from, from - glm::dvec2(0, pixels));
    }
};

TEST_F(EditsTest, WhatIsEditedOverAMotionStays) {
    Viewer& viewer = openMotion();
    const Motion& motion = *viewer.editor().motion();
    press("Right", 4);
    ASSERT_EQ(viewer.timeline(), 4);
    EXPECT_EQ(viewer.editor().pose(), motionPose(motion, 4));
    lift(50);
    Pose edited = viewer.editor().pose();
    ASSERT_NE(edited, motionPose(motion, 4));
    ASSERT_EQ(viewer.editor().keyframes().size(), 1u);
    EXPECT_EQ(viewer.editor().keyframes()[0].time, 4);
    press("Right");
    EXPECT_NE(viewer.editor().pose(), motionPose(motion, 5)) << "it fades out";
    press("Right", 15);
    EXPECT_EQ(viewer.editor().pose(), motionPose(motion, 20)) << "beyond it the motion's own";
    lift(30);
    Pose second = viewer.editor().pose();
    press("Left", 16);
    EXPECT_EQ(viewer.editor().pose(), edited);

    // Undo goes to the frame where it was done.
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.timeline(), 20);
    EXPECT_EQ(viewer.editor().pose(), motionPose(motion, 20));
    EXPECT_EQ(viewer.editor().keyframes().size(), 1u);
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.timeline(), 4);
    EXPECT_EQ(viewer.editor().pose(), motionPose(motion, 4));
    EXPECT_FALSE(viewer.editor().modified());
    keyWith("Control_L", "y");
    EXPECT_EQ(viewer.editor().pose(), edited);
    keyWith("Control_L", "y");
    EXPECT_EQ(viewer.timeline(), 20);
    EXPECT_EQ(viewer.editor().pose(), second);

    // It ends with what the window was opened with.
    for (int i = 0; i < 5; ++i) keyWith("Control_L", "z");
    EXPECT_TRUE(viewer.editor().motion());
    EXPECT_FALSE(viewer.editor().canUndo());
    for (int i = 0; i < 2; ++i) keyWith("Control_L", "y");
    EXPECT_EQ(viewer.editor().pose(), second);

    // A key of the keyboard lets edits override the motion, and add to it again.
    keyWith("Alt_L", "k");
    EXPECT_EQ(viewer.editor().layer().blend, Layer::Blend::Override);
    EXPECT_EQ(viewer.message(), "edits override the motion");
    EXPECT_EQ(viewer.editor().pose(), second) << "where the edit is its own place";
    keyWith("Alt_L", "k");
    EXPECT_EQ(viewer.editor().layer().blend, Layer::Blend::Add);
}

TEST_F(EditsTest, SavesWhatIsSeenAndAsksBeforeItOverwrites) {
    Viewer& viewer = openMotion();
    const std::vector<Theta> opened = viewer.editor().motion()->theta;  // of the avatar's body
    press("Right", 4);
    lift(50);
    keyWith("Control_L", "s");
    const fs::path file = *folder_ / "work" / "poses-1.npz";
    ASSERT_TRUE(fs::exists(file)) << viewer.message();
    EXPECT_FALSE(viewer.editor().modified());
    Motion saved = readMotion(file);
    ASSERT_EQ(saved.size(), 30u);
    for (size_t i : {0, 3, 4, 9, 29})
        EXPECT_EQ(saved.theta[i], thetaOf(viewer.editor().poseAt(double(i)))) << i;

    // The same file again, which is this window's.
    lift(20);
    keyWith("Control_L", "s");
    EXPECT_EQ(viewer.question(), "");
    EXPECT_FALSE(fs::exists(*folder_ / "work" / "poses-2.npz"));
    EXPECT_NE(readMotion(file).theta[4], saved.theta[4]);

    // Somebody else has written it since.
    lift(-20);
    fs::last_write_time(file, fs::last_write_time(file) + std::chrono::seconds(5));
    std::string theirs = bytesOf(file);
    keyWith("Control_L", "s");
    EXPECT_NE(viewer.question().find("poses-1.npz is there already"), std::string::npos);
    EXPECT_EQ(viewer.answers(),
              (std::vector<std::string>{"Save beside it", "Overwrite it", "Cancel"}));
    press("Escape");
    EXPECT_EQ(viewer.question(), "");
    EXPECT_EQ(bytesOf(file), theirs);
    EXPECT_TRUE(viewer.editor().modified());
    keyWith("Control_L", "s");
    viewer.answer("Save beside it");
    settle();
    EXPECT_EQ(bytesOf(file), theirs);
    EXPECT_TRUE(fs::exists(*folder_ / "work" / "poses-1-1.npz")) << viewer.message();
    EXPECT_FALSE(viewer.editor().modified());

    // It is read back as a motion with a key over it.
    const Pose edited = viewer.editor().poseAt(4);
    viewer.loadMotion("poses-1-1.npz");
    settle();
    ASSERT_EQ(viewer.editor().keyframes().size(), 1u);
    EXPECT_EQ(thetaOf(viewer.editor().poseAt(4)), thetaOf(edited));
    EXPECT_EQ(viewer.editor().motion()->theta, opened);
    EXPECT_FALSE(viewer.editor().modified());
}

TEST_F(EditsTest, EnterDoesNotOverwrite) {
    Viewer& viewer = openMotion();
    press("Right", 4);
    lift(50);
    keyWith("Control_L", "s");
    const fs::path work = *folder_ / "work";
    // Somebody else has written it since.
    std::ofstream(work / "poses-1.npz") << "theirs";
    fs::last_write_time(work / "poses-1.npz", fs::file_time_type::clock::now());
    lift(20);
    // An Enter that is held since before the question is no answer.
    screen_->keyDown("Return");
    turn();
    viewer.save();
    ptrdiff_t repeated = 0;
    await("the key to repeat", [&] {
        viewer.frame();
        repeated += std::ranges::count(viewer.window().keys(), true, &KeyPress::repeated);
        return repeated >= 3;
    });
    screen_->keyUp("Return");
    EXPECT_NE(viewer.question(), "");
    turn();
    press("Return");
    EXPECT_EQ(viewer.question(), "");
    EXPECT_EQ(bytesOf(work / "poses-1.npz"), "theirs");
    EXPECT_TRUE(fs::exists(work / "poses-1-1.npz")) << viewer.message();
    EXPECT_FALSE(viewer.editor().modified());
}

TEST_F(EditsTest, EachOpenedMotionHasItsOwnFile) {
    Viewer& viewer = openMotion();
    press("Right", 4);
    lift(50);
    keyWith("Control_L", "s");
    const fs::path first = *folder_ / "work" / "poses-1.npz",
                   second = *folder_ / "work" / "poses-2.npz";
    const std::string before = bytesOf(first);
    Motion other = turningMotion(10);
    writeNpz(*folder_ / "other.npz", posesArrays(other.theta, other.trans, {}), false);
    viewer.loadMotion(*folder_ / "other.npz");
    settle();
    press("Right", 2);
    lift(30);
    keyWith("Control_L", "s");
    ASSERT_TRUE(fs::exists(second)) << viewer.message();
    EXPECT_EQ(bytesOf(first), before);
    const std::string others = bytesOf(second);

    // Undo goes back to the first motion, and so to its file.
    keyWith("Control_L", "z");
    keyWith("Control_L", "z");
    ASSERT_EQ(viewer.frameCount(), 30);
    lift(20);
    keyWith("Control_L", "s");
    EXPECT_EQ(viewer.question(), "");
    EXPECT_EQ(bytesOf(second), others);
    EXPECT_NE(bytesOf(first), before);
    EXPECT_EQ(readMotion(first).size(), 30u);
    EXPECT_FALSE(fs::exists(*folder_ / "work" / "poses-3.npz"));

    // What is left when a motion is closed is no work.
    viewer.closeMotion();
    settle();
    EXPECT_FALSE(viewer.editor().modified());
}

TEST_F(EditsTest, NamesThatAreTakenAreLeftAlone) {
    Viewer& viewer = open();
    // A link to itself, whose end cannot be looked for.
    fs::create_symlink("poses-1.npz", "poses-1.npz");
    lift(40);
    keyWith("Control_L", "s");
    EXPECT_TRUE(fs::exists("poses-2.npz")) << viewer.message();
    EXPECT_TRUE(fs::is_symlink("poses-1.npz"));
    // Pictures that another window is still writing.
    AtomicFile theirs("doppel-1.png");
    OutputFolder frames("doppel-2.png", "render");
    press("F12");
    EXPECT_FALSE(fs::exists("doppel-1.png"));
    EXPECT_FALSE(fs::exists("doppel-2.png"));
    EXPECT_TRUE(fs::exists("doppel-3.png")) << viewer.message();
}

TEST_F(EditsTest, ClosingAsksForWhatIsNotSaved) {
    {
        Viewer& viewer = open();
        screen_->keyDown("Control_L");
        screen_->key("q");
        screen_->keyUp("Control_L");
        await("an unchanged window to close", [&] { return !viewer.frame(); });
    }
    Viewer& viewer = open();
    lift(40);
    keyWith("Control_L", "q");
    ASSERT_FALSE(viewer.window().closed());
    EXPECT_EQ(viewer.question(), "What you edited is not saved.");
    EXPECT_EQ(viewer.answers(), (std::vector<std::string>{"Save", "Do not save", "Cancel"}));
    // Under the question nothing else is done.
    Pose edited = viewer.editor().pose();
    double yaw = viewer.camera().yaw;
    drag({40, 300}, {90, 300}, 2);
    press("m");
    EXPECT_EQ(viewer.camera().yaw, yaw);
    EXPECT_EQ(viewer.editor().pose(), edited);
    press("Escape");
    EXPECT_EQ(viewer.question(), "");
    drag({40, 300}, {90, 300}, 2);
    EXPECT_NE(viewer.camera().yaw, yaw) << "the window goes on";

    keyWith("Control_L", "q");
    ASSERT_NE(viewer.question(), "");
    screen_->key("Return");
    await("the window to save and close", [&] { return !viewer.frame(); });
    EXPECT_EQ(thetaOf(edited), readMotion(*folder_ / "work" / "poses-1.npz").theta[0]);
}

TEST_F(EditsTest, TheWindowsOwnButtonAsks) {
    Viewer& viewer = open();
    lift(40);
    screen_->closeWindow();
    settle();
    EXPECT_EQ(viewer.question(), "What you edited is not saved.");
    press("Escape");
    EXPECT_EQ(viewer.question(), "");
    keyWith("Control_L", "z");
    ASSERT_FALSE(viewer.editor().modified());
    screen_->closeWindow();
    await("the window to close", [&] { return !viewer.frame(); });
}

TEST_F(EditsTest, OpeningAMotionAsksForWhatIsNotSaved) {
    Viewer& viewer = openMotion();
    press("Right", 4);
    lift(40);
    viewer.openFile(*folder_ / "motion.npz");
    settle();
    ASSERT_NE(viewer.question(), "");
    viewer.answer("Cancel");
    settle();
    EXPECT_EQ(viewer.editor().keyframes().size(), 1u);
    viewer.openFile(*folder_ / "motion.npz");
    settle();
    viewer.answer("Do not save");
    settle();
    EXPECT_TRUE(viewer.editor().keyframes().empty());
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().keyframes().size(), 1u) << "undo brings it back all the same";
}

// A window of its own process, ended by force; the next one of the same avatar offers what it had.
TEST_F(EditsTest, AKilledWindowsWorkIsOfferedAgain) {
    const fs::path program = fs::read_symlink("/proc/self/exe").parent_path() / "doppel";
    const fs::path sessions = *folder_ / "state" / "doppel" / "sessions";
    const std::string avatar = (*folder_ / "avatar").string();
    const auto files = [&] {
        int count = 0;
        std::error_code none;
        for (const auto& entry : fs::directory_iterator(sessions, none))
            count += entry.path().extension() == ".json";
        return count;
    };
    ViewerOptions options;
    options.state = *folder_ / "state" / "doppel";
    const std::string display = getenv("DISPLAY");
    for (bool byDisplay : {false, true}) {
        pid_t child = 0;
        {
            Screen other(600, 500);
            child = fork();
            if (child == 0) {
                setenv("XDG_STATE_HOME", (*folder_ / "state").string().c_str(), 1);
                execl(program.c_str(), program.c_str(), "view", avatar.c_str(), "--size", "600x500",
                      nullptr);
                _exit(127);
            }
            other.move(200, 200);
            // A key of the timeline is work.
            await("the other window to keep its session", [&] {
                other.key("k");
                std::this_thread::sleep_for(std::chrono::milliseconds(100));
                return files() == 1 || waitpid(child, nullptr, WNOHANG) != 0;
            });
            ASSERT_EQ(files(), 1);
            setenv("DISPLAY", display.c_str(), 1);
            if (!byDisplay) {
                // While it lives it is nobody else's.
                EXPECT_EQ(open(options).question(), "");
                viewer_.reset();
                kill(child, SIGKILL);
            }
        }
        if (byDisplay) {
            await("the window to end with its display",
                  [&] { return waitpid(child, nullptr, WNOHANG) == child; });
        } else {
            waitpid(child, nullptr, 0);
        }
        EXPECT_EQ(files(), 1);

        ASSERT_NE(open(options).question().find("one key"), std::string::npos);
        EXPECT_EQ(viewer_->answers(),
                  (std::vector<std::string>{"Bring it back", "Throw it away", "Not now"}));
        press("Escape");
        EXPECT_TRUE(viewer_->editor().keyframes().empty());
        viewer_.reset();
        EXPECT_EQ(files(), 1);
        Viewer& viewer = open(options);
        if (byDisplay) {
            viewer.answer("Throw it away");
            settle();
            EXPECT_EQ(files(), 0);
            continue;
        }
        press("Return");
        EXPECT_EQ(viewer.editor().keyframes().size(), 1u);
        EXPECT_TRUE(viewer.editor().modified());
        EXPECT_EQ(files(), 1) << "it is this window's now";
        keyWith("Control_L", "z");
        EXPECT_TRUE(viewer.editor().keyframes().empty());
        keyWith("Control_L", "y");
        keyWith("Control_L", "s");
        EXPECT_EQ(files(), 0) << "what is saved needs no keeping";
        viewer_.reset();
        EXPECT_EQ(open(options).question(), "");
        viewer_.reset();
    }
}

TEST_F(EditsTest, ASessionComesBackWithItsMotionAndShape) {
    Motion motion = turningMotion(12);
    fs::path poses = *folder_ / "motion.npz";
    writeNpz(poses, posesArrays(motion.theta, motion.trans, {}), false);
    ViewerOptions options;
    options.motion = poses;
    options.state = *folder_ / "state";
    open(options);
    press("Right", 3);
    lift(40);
    viewer_->editor().setBetas({1, 2, 3});
    settle();
    const Take before = viewer_->editor().take();
    viewer_.reset();  // without a question asked, as where an error ends it

    options.motion.clear();
    open(options);
    ASSERT_NE(viewer_->question(), "");
    press("Return");
    const Take after = viewer_->editor().take();
    EXPECT_EQ(after.keys, before.keys);
    EXPECT_EQ(after.betas, before.betas);
    ASSERT_TRUE(after.motion);
    EXPECT_EQ(after.motion->theta, before.motion->theta);
    EXPECT_EQ(viewer_->timeline(), 3);
    EXPECT_EQ(viewer_->editor().pose(), before.pose);
    viewer_.reset();

    // Without its motion the keys are there all the same, and the motion may come back; damaged
    // files are left alone.
    const fs::path sessions = *folder_ / "state" / "sessions", hidden = *folder_ / "hidden.npz";
    fs::rename(poses, hidden);
    std::ofstream(sessions / "view-0-0.json") << "{\"doppel_session\": 1";
    open(options);
    press("Return");
    EXPECT_EQ(viewer_->editor().keyframes().size(), 1u);
    EXPECT_NE(viewer_->message().find("not the motion under them"), std::string::npos);
    EXPECT_TRUE(fs::exists(sessions / "view-0-0.json"));
    keyWith("Control_L", "s");
    EXPECT_FALSE(viewer_->editor().modified());
    viewer_.reset();
    fs::rename(hidden, poses);
    open(options);
    ASSERT_NE(viewer_->question(), "") << "it waits for its motion";
    press("Return");
    ASSERT_TRUE(viewer_->editor().motion());
    EXPECT_EQ(viewer_->editor().take().keys, before.keys);
}

TEST_F(EditsTest, WhatCouldNotBeKeptIsTriedAgain) {
    const fs::path sessions = *folder_ / "state" / "sessions";
    fs::create_directories(sessions.parent_path());
    std::ofstream(sessions) << "a file in the way";
    ViewerOptions options;
    options.state = *folder_ / "state";
    Viewer& viewer = open(options);
    lift(40);
    EXPECT_NE(viewer.message().find("cannot be kept"), std::string::npos) << viewer.message();
    fs::remove(sessions);
    await("the session to be kept", [&] {
        viewer.frame();
        return fs::exists(sessions);
    });
}

// Whatever ends the program, the next start has what was edited.
TEST_F(EditsTest, AnyFailureLeavesTheSession) {
    ViewerOptions options;
    options.state = *folder_ / "state";
    Viewer& viewer = open(options);
    viewer.editor().setKeyframe(0);
    EXPECT_THROW(viewer.run([] { throw std::runtime_error("nobody thought of this"); }),
                 std::runtime_error);
    viewer_.reset();
    EXPECT_NE(open(options).question().find("one key"), std::string::npos);
}

TEST_F(EditsTest, UndoBringsTheCameraBackByChoice) {
    ViewerOptions options;
    options.avatar = *folder_ / "avatar";
    options.width = 900, options.height = 740;  // the panel has no need to scroll
    options.state = *folder_ / "state";
    Viewer& viewer = open(options);
    const auto orbitBy = [&](float pixels) {
        const glm::vec2 from(200, 60);
        drag(from, from + glm::vec2(pixels, 0));
        settle();
        return viewer.camera().yaw;
    };
    const auto undo = [&] {
        keyWith("Control_L", "z");
        settle();
    };
    const double first = viewer.camera().yaw, second = orbitBy(80);
    ASSERT_GT(std::abs(second - first), .05);
    EXPECT_FALSE(viewer.editor().canUndo());

    viewer.settings().panel = true;
    settle();
    clickItem("undo the camera, too");
    settle();
    viewer.settings().panel = false;
    settle();
    const double third = orbitBy(80);
    const Pose before = viewer.editor().pose();
    lift(30);
    ASSERT_NE(viewer.editor().pose(), before);
    const double fourth = orbitBy(-170);
    ASSERT_GT(std::abs(fourth - third), .05);
    undo();
    EXPECT_NEAR(viewer.camera().yaw, third, 1e-5);
    EXPECT_NE(viewer.editor().pose(), before);
    undo();
    EXPECT_EQ(viewer.editor().pose(), before);
    EXPECT_NEAR(viewer.camera().yaw, third, 1e-5);
    undo();
    EXPECT_NEAR(viewer.camera().yaw, second, 1e-5);
    EXPECT_FALSE(viewer.editor().canUndo());
    for (int i = 0; i < 3; ++i) {
        keyWith("Control_L", "y");
        settle();
    }
    EXPECT_NEAR(viewer.camera().yaw, fourth, 1e-5);
    EXPECT_FALSE(viewer.editor().canRedo());
    for (int i = 0; i < 3; ++i) undo();  // nothing is left unsaved

    // The next start knows the choice, and begins without a step.
    viewer_.reset();
    viewer_.emplace(options);
    settle();
    EXPECT_FALSE(viewer_->editor().canUndo());
    drag({200, 60}, {280, 60});
    settle();
    EXPECT_EQ(viewer_->editor().undoName(), "camera");
}

}  // namespace
}  // namespace doppel::test
