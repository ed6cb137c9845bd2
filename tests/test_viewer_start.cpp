// The window before there is an avatar: one that was opened before, one that is named or dropped,
// or one that is made of a clip. A script stands for `doppel avatar`.
#include "tests/making_program.h"
#include "tests/viewer_test.h"
#include "viewer/start/start_window.h"

namespace doppel::test {
namespace {

class StartTest : public ViewerTest {
protected:
    void SetUp() override {
        ViewerTest::SetUp();
        clip_ = *folder_ / "my clip.mp4";
        writeClip(clip_);
        options_.program = program_.path();
    }
    void TearDown() override {
        program_.end(1, "");  // whatever still runs
        start_.reset();
        if (program_.isThere("words"))
            await("the script's end", [&] { return program_.isThere("over"); });
        fs::remove_all(*folder_ / "my clip-avatar");
        ViewerTest::TearDown();
    }
    StartWindow& start() {
        start_.emplace(options_);
        screen_->move(9, 9);
        pass();
        screen_->move(3, 3);
        pass();
        return *start_;
    }
    void pass(int times = 4) {
        for (int i = 0; i < times; ++i) start_->frame();
    }
    void click(const std::string& label) {
        const glm::dvec2 place = itemAt(label);
        screen_->move(place.x, place.y);
        pass();
        screen_->press(1);
        pass();
        screen_->release(1);
        pass();
    }
    void drop(const fs::path& path) { drop(std::vector{path}); }
    void drop(const std::vector<fs::path>& paths) {
        EXPECT_TRUE(screen_->drop(uriList(paths), 60, 60, [&] { start_->frame(); }));
        pass();
    }
    void until(const std::string& what, const std::function<bool()>& holds) {
        await(what, [&] {
            start_->frame();
            return holds();
        });
    }
    // Until it says something.
    void make() {
        drop(clip_);
        start_->answer("Make it");
        until("its line", [&] { return start_->making() && start_->making()->line() != "starts"; });
    }
    static void awaitEnd(Viewer& viewer) {
        await("its end", [&] {
            viewer.frame();
            return !viewer.making();
        });
    }
    static bool isDrawn(const std::string& label) {
        return std::ranges::count(drawnItems(), label, &DrawnItem::label) > 0;
    }
    Image seen() {
        const Canvas drawn = start_->window().drawn();
        Image image(drawn.width, drawn.height, 3);
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x)
                for (int c = 0; c < 3; ++c)
                    image.pixel(x, y)[drawn.blueFirst ? 2 - c : c] =
                        static_cast<uint8_t>(drawn.row(y)[static_cast<size_t>(x)] >> 8 * c);
        return image;
    }

    MakingProgram program_;
    fs::path clip_;
    ViewerOptions options_;
    std::optional<StartWindow> start_;
};

TEST_F(StartTest, ADroppedAvatarIsChosen) {
    StartWindow& window = start();
    drop(*folder_ / "avatar");
    EXPECT_EQ(window.chosen(), *folder_ / "avatar");
    EXPECT_FALSE(window.frame());
    EXPECT_FALSE(window.takeMaking());
}

// As `doppel avatar` and `doppel demo` leave it.
TEST_F(StartTest, SoIsAPersonsFolder) {
    fs::create_directories(*folder_ / "she");
    fs::copy(*folder_ / "avatar", *folder_ / "she" / "avatar", fs::copy_options::recursive);
    StartWindow& window = start();
    drop(*folder_ / "she");
    EXPECT_EQ(window.chosen(), *folder_ / "she" / "avatar");
}

TEST_F(StartTest, OneIsNamed) {
    StartWindow& window = start();
    click("path");
    for (const char c : (*folder_ / "avatar").string()) {
        const bool shifted = c >= 'A' && c <= 'Z';
        if (shifted) screen_->keyDown("Shift_L");
        screen_->key(c == '/'   ? "slash"
                     : c == '.' ? "period"
                     : c == '-' ? "minus"
                                : std::string(1, c));
        if (shifted) screen_->keyUp("Shift_L");
        pass(2);
    }
    EXPECT_FALSE(window.chosen());
    screen_->key("Return");
    pass();
    EXPECT_EQ(window.chosen(), *folder_ / "avatar") << window.message();
}

// What the viewer has opened is shown the next time, by its preview; what is gone is not.
TEST_F(StartTest, WhatWasOpenedBeforeIsShown) {
    options_.state = *folder_ / "state";
    fs::remove_all(options_.state);
    fs::copy(*folder_ / "avatar", *folder_ / "red", fs::copy_options::recursive);
    fs::copy(*folder_ / "avatar", *folder_ / "gone", fs::copy_options::recursive);
    Image red(40, 20, 3);
    for (size_t i = 0; i < red.data.size(); i += 3) red.data[i] = 250;
    writeImage(*folder_ / "red" / "preview.png", red);
    for (const char* name : {"gone", "red"}) {
        ViewerOptions options;
        options.state = options_.state;
        options.avatar = *folder_ / name;
        open(options);
        viewer_.reset();
    }
    fs::remove_all(*folder_ / "gone");

    StartWindow& window = start();
    EXPECT_FALSE(isDrawn("gone"));
    const Image picture = seen();
    const glm::dvec2 card = itemAt("red");
    const uint8_t* pixel = picture.pixel(static_cast<int>(card.x), static_cast<int>(card.y));
    EXPECT_GT(pixel[0], 240);
    EXPECT_LT(pixel[1], 10);
    click("red");
    EXPECT_EQ(window.chosen(), fs::weakly_canonical(*folder_ / "red"));
}

TEST_F(StartTest, WhatIsNoAvatarIsSaid) {
    StartWindow& window = start();
    std::ofstream(*folder_ / "notes.txt") << "none\n";
    drop(*folder_ / "notes.txt");
    EXPECT_NE(window.message().find("notes.txt: expected an avatar's folder, a clip"),
              std::string::npos)
        << window.message();

    writeColouredCapture(*folder_ / "recorded", turningMotion(2));
    writeImage(*folder_ / "recorded" / "overlay.jpg", Image(20, 20, 3, 90));
    drop(*folder_ / "recorded");
    EXPECT_NE(window.message().find("found a capture; `doppel train "), std::string::npos)
        << window.message() << window.question().text();

    fs::create_directories(*folder_ / "broken");
    std::ofstream(*folder_ / "broken" / "avatar.toml") << "format = 7\n";
    drop(*folder_ / "broken");
    EXPECT_NE(window.message().find("body.npz"), std::string::npos) << window.message();
    EXPECT_FALSE(window.chosen());
    EXPECT_TRUE(window.frame());
}

// The viewer opens it while it is still made, and has it to the end.
TEST_F(StartTest, AClipBecomesOne) {
    Avatar taller = plainAvatar();
    taller.betas = {2, 0, 0};
    program_.makes(taller);
    StartWindow& window = start();
    drop(clip_);
    EXPECT_NE(window.question().text().find("person in my clip.mp4 goes into "), std::string::npos);
    screen_->key("Return");
    until("its line", [&] {
        return window.making() && window.making()->line() == "find the person 3/6  0:10 left";
    });
    pass();
    EXPECT_TRUE(isDrawn("find the person 3/6, 0:10 left"));
    EXPECT_TRUE(isDrawn("progress"));
    EXPECT_FALSE(isDrawn("choose a clip"));
    drop(clip_);
    EXPECT_NE(window.message().find("is being made already"), std::string::npos);

    program_.go();
    until("the avatar", [&] { return window.chosen().has_value(); });
    EXPECT_EQ(window.chosen(), *folder_ / "my clip-avatar" / "avatar");
    std::optional<Making> making = window.takeMaking();
    ASSERT_TRUE(making);
    std::unique_ptr<Window> same = window.takeWindow();
    start_.reset();

    ViewerOptions options = options_;
    options.avatar = *folder_ / "my clip-avatar" / "avatar";
    Viewer viewer(options, std::move(same), std::move(making));
    EXPECT_EQ(viewer.avatar().betas[0], 2);
    EXPECT_EQ(viewer.making()->clip(), clip_);
    program_.end(0, "");
    awaitEnd(viewer);
    EXPECT_EQ(viewer.message(), "avatar in " + options.avatar.string());
}

// Whoever looks at another avatar meanwhile has it to look at until the new one is there.
TEST_F(StartTest, AnotherIsOpenedWhileItIsMade) {
    Avatar taller = plainAvatar();
    taller.betas = {2, 0, 0};
    program_.makes(taller);
    StartWindow& window = start();
    make();
    drop(*folder_ / "avatar");
    EXPECT_EQ(window.chosen(), *folder_ / "avatar");
    ViewerOptions options = options_;
    options.avatar = *window.chosen();
    std::optional<Making> making = window.takeMaking();
    start_.reset();
    Viewer viewer(options, {}, std::move(making));
    EXPECT_NE(viewer.avatar().betas[0], 2);
    program_.go();
    await("the avatar", [&] {
        viewer.frame();
        return viewer.avatar().betas[0] == 2;
    });
    program_.end(0, "");
    awaitEnd(viewer);
}

// The window that is there shows what was chosen, whoever presents it, with what was dropped
// beside; it is as large as a viewer's, unless the user had another mind.
TEST_F(StartTest, TheViewerGoesOnInTheSameWindow) {
    const Motion motion = turningMotion(7);
    writeNpz(*folder_ / "walk.npz", posesArrays(motion.theta, motion.trans, {}), false);
    options_.width = 900, options_.height = 700;
    for (const char* how : {"host", "direct"}) {
        SCOPED_TRACE(how);
        const Presenting presenting(how);
        StartWindow& window = start();
        const bool resized = how == std::string_view("direct");
        if (resized) screen_->resizeWindow(640, 520);
        pass();
        const unsigned long id = screen_->window();
        drop({*folder_ / "walk.npz", *folder_ / "avatar"});
        ASSERT_EQ(window.chosen(), *folder_ / "avatar");
        EXPECT_TRUE(isDrawn(fmt::format("Opens {} ...", folder_->path().filename().string())));

        ViewerOptions options = options_;
        options.avatar = *window.chosen();
        viewer_.emplace(options, window.takeWindow());
        start_.reset();
        EXPECT_EQ(viewer_->window().width(), resized ? 640 : 900);
        EXPECT_EQ(viewer_->window().height(), resized ? 520 : 700);
        EXPECT_EQ(viewer_->window().directly(), resized);
        settle();
        EXPECT_EQ(viewer_->frameCount(), 7) << viewer_->message();
        EXPECT_EQ(screen_->window(), id);
        EXPECT_EQ(screen_->title(), "avatar - Doppel");
        ViewerTest::window();  // which waits for the screen to show it
        viewer_.reset();
    }
}

// As `doppel view CLIP` does.
TEST_F(StartTest, AClipThatIsNamedIsAskedAbout) {
    options_.avatar = clip_;
    StartWindow& window = start();
    EXPECT_NE(window.question().text().find("my clip.mp4"), std::string::npos);
    screen_->key("Escape");
    pass();
    EXPECT_FALSE(window.question());
    EXPECT_FALSE(window.making());
    EXPECT_FALSE(program_.isThere("words"));
}

TEST_F(StartTest, WhatGoesWrongIsSaidAndItGoesOn) {
    StartWindow& window = start();
    make();
    program_.end(2, "doppel: my clip.mp4: expected a person\n");
    until("its end", [&] { return !window.making(); });
    EXPECT_EQ(window.message(), "my clip.mp4: expected a person");
    EXPECT_FALSE(window.chosen());
    pass();
    EXPECT_TRUE(isDrawn("open"));
}

TEST_F(StartTest, ClosedMeanwhileItAsks) {
    StartWindow& window = start();
    make();
    screen_->closeWindow();
    until("a question", [&] { return bool(window.question()); });
    EXPECT_NE(window.question().text().find("An avatar of my clip.mp4 is being made"),
              std::string::npos);
    window.answer("Cancel");
    pass();
    EXPECT_TRUE(window.making());
    pass();
    click("stop making it");
    until("its end", [&] { return !window.making(); });
    EXPECT_TRUE(program_.isThere("stopped"));
    EXPECT_EQ(window.message(), "my clip.mp4: stopped; dropped again it goes on from there");
    screen_->closeWindow();
    until("its end", [&] { return window.window().closed(); });
    EXPECT_FALSE(window.frame());
    EXPECT_FALSE(window.chosen());
}

// In a small window, and with letters twice as large.
TEST_F(StartTest, NothingIsCut) {
    options_.state = *folder_ / "state";
    for (const double scale : {1., 1.5, 2.}) {
        options_.scale = scale;
        start();
        screen_->resizeWindow(600, 500);
        pass(8);
        EXPECT_GT(drawnItems().size(), 5u);
        for (const DrawnItem& item : drawnItems()) EXPECT_FALSE(item.cut) << item.label << scale;
    }
}

}  // namespace
}  // namespace doppel::test
