// What is dropped on the window, as a file manager drops it.
#include "engine/error.h"
#include "tests/viewer_test.h"
#include "trainer/avatar/export.h"
#include "trainer/motion/upright.h"

namespace doppel::test {
namespace {

class DropsTest : public ViewerTest {
protected:
    // A motion in the format of the name's ending.
    fs::path motionFile(const std::string& name, size_t frames) {
        const Motion motion = turningMotion(frames);
        const fs::path path = *folder_ / name;
        fs::create_directories(path.parent_path());
        Device device;
        exportAvatar(device, plainAvatar(), path, &motion);
        return path;
    }
    fs::path poses(const std::string& name, size_t frames) {
        const Motion motion = turningMotion(frames);
        writeNpz(*folder_ / name, posesArrays(motion.theta, motion.trans, {}), false);
        return *folder_ / name;
    }
    fs::path picture(const std::string& name, std::array<uint8_t, 3> rgb) {
        Image image(40, 30, 3);
        for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = rgb[i % 3];
        writeImage(*folder_ / name, image);
        return *folder_ / name;
    }
    fs::path text(const std::string& name, const std::string& content) {
        std::ofstream(*folder_ / name) << content;
        return *folder_ / name;
    }
};

// And says what it was taken to mean, which other programs may have meant otherwise.
TEST_F(DropsTest, AMotionOfEachFormatPlays) {
    Viewer& viewer = openTab("Files");
    clickItem("messages");
    struct Case {
        const char *name, *says;
    };
    size_t frames = 3;
    for (const Case& c :
         {Case{"a walk.bvh", "metres to the unit, y up"}, Case{"50% done #2?.glb", "y up"},
          Case{"AMASS/walk+run_poses.npz", "AMASS, 20 a second, z up"},
          Case{"B\u00fchne \u6b69\u304f.json", "y up"}}) {
        const fs::path file = motionFile(c.name, ++frames);
        dropOnWindow({file});
        EXPECT_EQ(viewer.frameCount(), static_cast<int64_t>(frames)) << c.name << viewer.message();
        EXPECT_EQ(viewer.timeline(), 0) << c.name;
        const std::string taken = takenAs(readMotion(file));
        EXPECT_TRUE(taken.ends_with(c.says)) << taken;
        itemAt(file.filename().string() + ": " + taken);
    }
    dropOnWindow({poses("own poses.npz", 9)});
    EXPECT_EQ(viewer.frameCount(), 9);
    itemAt("own poses.npz: y down, as before a camera");
    // It can be undone, as what is opened by name.
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.frameCount(), static_cast<int64_t>(frames));
}

TEST_F(DropsTest, ACaptureIsSeenThroughItsCamera) {
    Viewer& viewer = open();
    const fs::path capture = *folder_ / "the capture";
    writeColouredCapture(capture, turningMotion(3));
    dropOnWindow({capture});
    EXPECT_EQ(viewer.frameCount(), 3);
    screen_->key("0");
    settle();
    EXPECT_TRUE(viewer.settings().captureCamera);
    EXPECT_GT(ViewerTest::picture().pixel(33, 300)[0], 150) << "its first frame is red";
}

TEST_F(DropsTest, AnAvatarsFolderOrItsFile) {
    Avatar tall = plainAvatar();
    tall.betas[0] = 3;
    writeAvatar(*folder_ / "a tall one", tall);
    Viewer& viewer = open();
    dropOnWindow({*folder_ / "a tall one"});
    EXPECT_EQ(viewer.editor().betas()[0], 3) << viewer.message();
    EXPECT_EQ(viewer.message(), "the avatar a tall one");
    dropOnWindow({*folder_ / "avatar" / "avatar.toml"});
    EXPECT_EQ(viewer.editor().betas(), plainAvatar().betas);
}

TEST_F(DropsTest, PosesPicturesAndKeys) {
    Viewer& viewer = open();
    dropOnWindow(
        {text("a pose.json", R"({"doppel_pose": 1, "joints": {"left_wrist": [0.5, 0, -1]}})")});
    EXPECT_NEAR(viewer.editor().pose().rotation[joint::kLeftWrist].x, .5, 1e-6);
    dropOnWindow({picture("all red.png", {220, 10, 10})});
    EXPECT_EQ(viewer.settings().backdrop, Backdrop::Picture);
    const Image seen = ViewerTest::picture();
    EXPECT_GT(seen.pixel(5, 300)[0], 200);
    EXPECT_LT(seen.pixel(5, 300)[1], 30);
    dropOnWindow({text("my keys.toml", "preset = \"gltf\"\nplay = [\"P\"]\n")});
    EXPECT_EQ(viewer.keys().keyOf(Action::Play), "P");
}

TEST_F(DropsTest, SeveralFilesAtOnceAreOpenedInTheirOrder) {
    Viewer& viewer = open();
    dropOnWindow({poses("first.npz", 4), picture("green.png", {10, 200, 10}),
                  poses("second.npz", 6), text("nothing.txt", "nothing")});
    EXPECT_EQ(viewer.frameCount(), 6);
    EXPECT_EQ(viewer.settings().backdrop, Backdrop::Picture);
    EXPECT_NE(viewer.message().find("nothing.txt"), std::string::npos) << viewer.message();
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.frameCount(), 4);
}

TEST_F(DropsTest, WhatIsNothingIsSaid) {
    Viewer& viewer = open();
    struct Case {
        fs::path path;
        const char* says;
    };
    fs::create_directories(*folder_ / "some pictures");
    for (const Case& c :
         {Case{text("notes 1.txt", "nothing"), "the window opens avatars, captures"},
          Case{*folder_ / "some pictures", "`doppel import "},
          Case{text("broken.bvh", "HIERARCHY\nROOT"), "broken.bvh"},
          Case{text("broken.json", "{"), "broken.json"},
          Case{*folder_ / "gone since.npz", "gone since.npz"}}) {
        dropOnWindow({c.path});
        EXPECT_NE(viewer.message().find(c.says), std::string::npos)
            << c.path << ": " << viewer.message();
    }
    // From a browser, an address.
    EXPECT_TRUE(
        screen_->drop("https://example.com/a%20walk.bvh\r\n", 60, 60, [&] { viewer.frame(); }));
    settle();
    EXPECT_NE(viewer.message().find("example.com"), std::string::npos) << viewer.message();
}

TEST_F(DropsTest, AvatarsGiveWhatTheyWearWhileTheMixIsOpen) {
    for (const char* name : {"giver one", "giver two"}) writeAvatar(*folder_ / name, plainAvatar());
    Viewer& viewer = open();
    viewer.settings().panel = true;
    settle();
    clickItem("Mix");
    const std::string title = screen_->title();
    dropOnWindow({*folder_ / "giver one", *folder_ / "giver two"});
    EXPECT_EQ(screen_->title(), title) << "the avatar is not another one";
    clickItem("top");
    itemAt("giver one");
    itemAt("giver two");
}

// What is asked about stays as it is until it is answered; then the next file has its turn.
TEST_F(DropsTest, FilesWaitUntilAQuestionIsAnswered) {
    const fs::path first = poses("four.npz", 4), second = poses("five.npz", 5),
                   third = poses("six.npz", 6);
    Viewer& viewer = open();
    viewer.editor().setKeyframe(0);
    dropOnWindow({first, second});
    const std::string asked = viewer.question();
    EXPECT_NE(asked.find("four.npz"), std::string::npos) << asked;
    dropOnWindow({third, picture("blue.png", {0, 0, 220})});
    EXPECT_EQ(viewer.question(), asked);
    EXPECT_EQ(viewer.message(), "what was dropped is opened once the question is answered");
    EXPECT_EQ(viewer.settings().backdrop, Backdrop::Colour);
    EXPECT_EQ(viewer.frameCount(), 1);
    viewer.answer("Cancel");
    settle();
    EXPECT_NE(viewer.question().find("five.npz"), std::string::npos) << viewer.question();
    EXPECT_EQ(viewer.editor().keyframes().size(), 1u);
    viewer.answer("Do not save");
    settle();
    EXPECT_EQ(viewer.question(), "") << "nothing is left that could be lost";
    EXPECT_EQ(viewer.frameCount(), 6);
    EXPECT_EQ(viewer.settings().backdrop, Backdrop::Picture);
}

TEST_F(DropsTest, NothingOpensBeneathTheOfferOfWhatWasNotSaved) {
    ViewerOptions options;
    options.state = *folder_ / "state";
    open(options).editor().setKeyframe(3);
    settle();
    viewer_.reset();
    Viewer& viewer = open(options);
    const std::string offered = viewer.question();
    ASSERT_NE(offered.find("one key"), std::string::npos) << offered;
    dropOnWindow({poses("seven.npz", 7)});
    EXPECT_EQ(viewer.question(), offered);
    EXPECT_EQ(viewer.frameCount(), 1);
    screen_->key("Return");
    settle();
    EXPECT_EQ(viewer.editor().keyframes().size(), 1u);
    // What is back is not saved, so the motion asks in its turn.
    EXPECT_NE(viewer.question().find("seven.npz"), std::string::npos) << viewer.question();
}

}  // namespace
}  // namespace doppel::test
