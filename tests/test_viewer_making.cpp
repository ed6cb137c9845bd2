// A clip that is dropped on the window becomes an avatar: asked for, watched, stopped. A script
// stands for `doppel avatar`, whose minutes no window needs; README's test runs the program itself.
#include "tests/making_program.h"
#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

class MakingTest : public ViewerTest {
protected:
    void SetUp() override {
        ViewerTest::SetUp();
        clip_ = *folder_ / "my clip.mp4";
        writeClip(clip_);
        Avatar taller = plainAvatar();
        taller.betas = {2, 0, 0};
        program_.makes(taller);
    }
    void TearDown() override {
        end(1, "");  // whatever still runs
        viewer_.reset();
        if (isThere("words")) await("the script's end", [&] { return isThere("over"); });
        fs::remove_all(made());
        ViewerTest::TearDown();
    }
    fs::path made() const { return *folder_ / "my clip-avatar"; }
    bool isThere(const char* name) const { return program_.isThere(name); }
    void go() const { program_.go(); }
    void end(int status, const std::string& said) const { program_.end(status, said); }
    Viewer& opened() {
        ViewerOptions options;
        options.program = program_.path();
        options.width = 980, options.height = 740;
        return open(options);
    }
    void until(const std::string& what, const std::function<bool()>& holds) {
        await(what, [&] {
            viewer_->frame();
            return holds();
        });
    }
    void untilItSays(const std::string& line) {
        until(line, [&] { return viewer_->making() && viewer_->making()->line() == line; });
    }
    void make() {
        dropOnWindow({clip_});
        viewer_->answer("Make it");
        untilItSays("find the person 3/6  0:10 left");
    }

    MakingProgram program_;
    fs::path clip_;
};

TEST_F(MakingTest, IsAskedForWatchedAndShown) {
    Viewer& viewer = opened();
    dropOnWindow({clip_});
    EXPECT_NE(viewer.question().find("person in my clip.mp4 goes into " + made().string()),
              std::string::npos)
        << viewer.question();
    EXPECT_EQ(viewer.answers(), (std::vector<std::string>{"Make it", "Cancel"}));
    viewer.answer("Cancel");
    turn();
    EXPECT_FALSE(viewer.making());
    EXPECT_FALSE(isThere("words"));

    const Image before = window();
    make();
    EXPECT_EQ(program_.words(),
              fmt::format("avatar {} --out {}\n", clip_.string(), made().string()));
    EXPECT_EQ(program_.seconds(), "2\n") << "its line is looked at";
    EXPECT_EQ(viewer.making()->share(), .5);
    settle();
    EXPECT_GT(difference(before, window()), .001);  // its line
    EXPECT_NE(viewer.avatar().betas[0], 2);

    // Shown as soon as it is there, while the program goes on.
    go();
    until("the avatar", [&] { return viewer.avatar().betas[0] == 2; });
    untilItSays("texels 5/10  loss 0.1  0:05 left");
    EXPECT_EQ(viewer.making()->brief(), "texels 5/10, 0:05 left");

    // One at a time.
    dropOnWindow({clip_});
    EXPECT_NE(viewer.message().find("is being made already"), std::string::npos);
    EXPECT_EQ(viewer.question(), "");

    end(0, "");
    until("its end", [&] { return !viewer.making(); });
    EXPECT_EQ(viewer.message(), "avatar in " + (made() / "avatar").string());
}

// Also while the panel dresses somebody by whoever is opened.
TEST_F(MakingTest, IsShownAndNotMixed) {
    Viewer& viewer = opened();
    viewer.settings().panel = true;
    settle();
    clickItem("Mix");
    make();
    end(0, "");
    until("the avatar", [&] { return viewer.avatar().betas[0] == 2; });
    until("its end", [&] { return !viewer.making(); });
}

TEST_F(MakingTest, WhatWentWrongIsSaid) {
    Viewer& viewer = opened();
    program_.makesNone();
    make();
    end(2, "doppel: my clip.mp4: expected a person\n");
    until("its end", [&] { return !viewer.making(); });
    EXPECT_EQ(viewer.message(), "my clip.mp4: expected a person");
    EXPECT_NE(viewer.avatar().betas[0], 2);
}

TEST_F(MakingTest, IsStoppedInThePanel) {
    Viewer& viewer = opened();
    viewer.settings().panel = true;
    settle();
    clickItem("Files");
    make();
    turn(4);
    clickItem("stop making it");
    until("its end", [&] { return !viewer.making(); });
    EXPECT_TRUE(isThere("stopped"));
    EXPECT_EQ(viewer.message(), "my clip.mp4: stopped; dropped again it goes on from there");

    // Begun again it says what is new, and the log keeps what was said.
    make();
    const std::string log = bytesOf(made() / "log.txt");
    EXPECT_LT(log.find("interrupted"), log.rfind("a first line"));
}

TEST_F(MakingTest, AWindowThatIsClosedAsks) {
    Viewer& viewer = opened();
    make();
    const auto close = [&] {
        screen_->closeWindow();
        until("a question", [&] { return !viewer.question().empty(); });
        EXPECT_NE(viewer.question().find("An avatar of my clip.mp4 is being made: find the person"),
                  std::string::npos)
            << viewer.question();
    };
    close();
    viewer.answer("Cancel");
    turn();
    EXPECT_TRUE(viewer.making());
    close();
    viewer.answer("Stop it, and close");
    EXPECT_FALSE(viewer.frame());
    await("its end", [&] { return isThere("stopped"); });
    EXPECT_NE(bytesOf(made() / "log.txt").find("doppel: interrupted"), std::string::npos);
}

// What else is there is nobody's to write over.
TEST_F(MakingTest, AFolderOfOthersIsLeftAlone) {
    Viewer& viewer = opened();
    fs::create_directories(made());
    std::ofstream(made() / "log.txt") << "a diary\n";
    dropOnWindow({clip_});
    viewer.answer("Make it");
    turn();
    EXPECT_FALSE(viewer.making());
    EXPECT_NE(viewer.message().find("log.txt"), std::string::npos) << viewer.message();
    EXPECT_EQ(bytesOf(made() / "log.txt"), "a diary\n");
}

TEST_F(MakingTest, GoesOnWithoutTheWindow) {
    Viewer& viewer = opened();
    make();
    screen_->closeWindow();
    until("a question", [&] { return !viewer.question().empty(); });
    viewer.answer("Let it go on, and close");
    EXPECT_FALSE(viewer.frame());
    viewer_.reset();
    EXPECT_FALSE(isThere("stopped"));
    go();
    await("the avatar", [&] { return fs::exists(made() / "avatar" / "avatar.toml"); });
}

TEST_F(MakingTest, OfAFolderOfPicturesAsWell) {
    Viewer& viewer = opened();
    const fs::path pictures = *folder_ / "photos";
    fs::create_directories(pictures);
    writeImage(pictures / "a.png", Image(20, 20, 3, 90));
    dropOnWindow({pictures});
    EXPECT_NE(viewer.question().find((*folder_ / "photos-avatar").string()), std::string::npos)
        << viewer.question() << viewer.message();
    viewer.answer("Cancel");
    turn();
}

TEST_F(MakingTest, AProgramThatIsNotThereIsSaid) {
    Viewer& viewer = opened();
    fs::remove(program_.path());
    dropOnWindow({clip_});
    viewer.answer("Make it");
    turn();
    EXPECT_FALSE(viewer.making());
    EXPECT_NE(viewer.message().find("cannot be started"), std::string::npos) << viewer.message();
    EXPECT_FALSE(fs::exists(made()));
}

}  // namespace
}  // namespace doppel::test
