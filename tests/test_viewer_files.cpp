// Opening and saving: another avatar in the same window, and the desktop's dialogs for files.
#include "engine/error.h"
#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

// Another person: taller, without a mesh network.
Avatar tallAvatar() {
    Avatar avatar = plainAvatar();
    avatar.betas[0] = 3;
    return avatar;
}

TEST_F(ViewerTest, AnotherAvatarTakesPoseMotionAndView) {
    writeAvatar(*folder_ / "tall", tallAvatar());
    Motion motion = turningMotion(5);
    const fs::path poses = *folder_ / "turn.npz";
    writeNpz(poses, posesArrays(motion.theta, motion.trans, {}), false);
    ViewerOptions options;
    options.motion = poses;
    Viewer& viewer = open(options);
    screen_->key("Right");
    settle();
    const OrbitCamera camera = viewer.camera();
    const double hips = viewer.posed().position[joint::kPelvis].y,
                 head = viewer.posed().position[joint::kHead].y;
    const Image before = picture();
    viewer.openFile(*folder_ / "tall");
    settle();
    EXPECT_EQ(viewer.editor().betas()[0], 3);
    EXPECT_EQ(viewer.frameCount(), 5);
    EXPECT_EQ(viewer.message(), "the avatar tall");
    EXPECT_GT(std::abs(viewer.posed().position[joint::kHead].y -
                       viewer.posed().position[joint::kPelvis].y),
              std::abs(head - hips) + .01)
        << "the skeleton is the taller one's";
    EXPECT_GT(difference(picture(), before), .01);

    // Back by a file of the folder, and with a pose that was edited, which stays.
    viewer.closeMotion();
    viewer.camera() = camera;
    Pose pose = viewer.editor().pose();
    pose.rotation[joint::kLeftElbow] = {0, -.8, 0};
    viewer.editor().setPose(pose);
    viewer.openFile(*folder_ / "avatar" / "avatar.toml");
    settle();
    EXPECT_EQ(viewer.editor().pose(), pose);
    EXPECT_EQ(viewer.editor().betas(), plainAvatar().betas);
    EXPECT_EQ(viewer.camera().target, camera.target);
    EXPECT_EQ(viewer.camera().distance, camera.distance);
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose().rotation[joint::kLeftElbow], glm::dvec3(0));

    // What is broken leaves the window as it is.
    fs::create_directory(*folder_ / "broken");
    std::ofstream(*folder_ / "broken" / "avatar.toml") << "name = 3";
    const Image whole = picture();
    EXPECT_FALSE(messageOf<InputError>([&] { viewer.openFile(*folder_ / "broken"); }).empty());
    settle();
    EXPECT_LT(difference(picture(), whole), .001);
}

// By what they hold; what is nothing of that says what to do.
TEST_F(ViewerTest, WhatIsOpenedTellsByContentWhatItIs) {
    Viewer& viewer = open();
    const fs::path keys = *folder_ / "my keys.toml";
    std::ofstream(keys) << "preset = \"gltf\"\nplay = [\"P\"]\n";
    viewer.openFile(keys);
    EXPECT_EQ(viewer.keys().keyOf(Action::Play), "P");
    const auto refusal = [&](const fs::path& path) {
        return messageOf<InputError>([&] { viewer.openFile(path); });
    };
    const fs::path clip = *folder_ / "clip.mp4";
    viewer.startFilm(clip, {.size = 64, .turntable = true, .turnSeconds = 1});
    for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
    fs::rename(clip, *folder_ / "clip");
    viewer.openFile(*folder_ / "clip");
    EXPECT_NE(viewer.question().find("An avatar of the person in clip goes into"),
              std::string::npos)
        << viewer.question();
    viewer.answer("Cancel");
    fs::create_directories(*folder_ / "pictures");
    EXPECT_NE(refusal(*folder_ / "pictures").find("`doppel import "), std::string::npos)
        << refusal(*folder_ / "pictures");
    // A pose has joints as motions in JSON have.
    const fs::path pose = *folder_ / "pose.json";
    std::ofstream(pose) << R"({"doppel_pose": 1, "joints": {"left_wrist": [0.5, 0, -1]}})";
    viewer.openFile(pose);
    EXPECT_NEAR(viewer.editor().pose().rotation[joint::kLeftWrist].x, .5, 1e-6);
    std::ofstream(*folder_ / "notes.txt") << "nothing";
    EXPECT_NE(refusal(*folder_ / "notes.txt").find("the window opens avatars, captures"),
              std::string::npos)
        << refusal(*folder_ / "notes.txt");
}

// Poses are kept as files, which are chosen by their pictures, named and forgotten.
TEST_F(ViewerTest, PosesAreKeptForAllAvatars) {
    ViewerOptions options;
    options.width = 980, options.height = 740;
    options.state = *folder_ / "library";
    const fs::path poses = options.state / "poses";
    fs::create_directories(poses / "a folder.json");
    std::ofstream(poses / "broken.json") << "{\"doppel_pose\": 1, \"joints\": 3}";
    std::ofstream(poses / "large.json") << std::string(100'000, ' ');
    std::ofstream(poses / "notes.txt") << "{}";
    Viewer& viewer = open(options);
    viewer.settings().panel = true;
    const Pose straight = viewer.editor().pose();
    Pose bent = straight;
    bent.rotation[joint::kLeftElbow] = {0, -.9, 0};
    bent.rotation[joint::kRightHip] = {-.7, 0, 0};
    viewer.editor().setPose(bent);
    settle();
    clickItem("Pose");
    clickItem("kept poses");
    clickItem("keep this pose");
    EXPECT_TRUE(fs::exists(poses / "pose 1.json"));
    const auto shownOf = [&](const std::string& pose) {
        const auto item = std::ranges::find(drawnItems(), "pose: " + pose, &DrawnItem::label);
        screen_->move(20, 20);
        settle();
        window();  // is on the screen
        return screen_->grab(static_cast<int>(item->low.x) + 2, static_cast<int>(item->low.y) + 2,
                             static_cast<int>(item->high.x - item->low.x) - 4,
                             static_cast<int>(item->high.y - item->low.y) - 4);
    };
    const Image picture = shownOf("pose 1");
    int body = 0;
    for (int y = 0; y < picture.height; ++y)
        for (int x = 0; x < picture.width; ++x)
            body += !std::equal(picture.pixel(x, y), picture.pixel(x, y) + 3, picture.pixel(0, 0));
    EXPECT_GT(body, .1 * picture.width * picture.height) << "the avatar is in it";
    EXPECT_LT(body, .7 * picture.width * picture.height);
    viewer.editor().setPose(straight);
    settle();
    const size_t steps = viewer.editor().steps();
    clickItem("pose: pose 1");
    EXPECT_EQ(viewer.editor().pose(), bent);
    EXPECT_EQ(viewer.editor().steps(), steps + 1);
    clickItem("undo");
    EXPECT_EQ(viewer.editor().pose(), straight);
    // Mirrored, and where the body stands then.
    Pose elsewhere = straight;
    elsewhere.trans.x += .2;
    viewer.editor().setPose(elsewhere);
    settle();
    screen_->keyDown("Shift_L");
    clickItem("pose: pose 1");
    screen_->keyUp("Shift_L");
    EXPECT_EQ(viewer.editor().pose().trans.x, elsewhere.trans.x);
    EXPECT_NEAR(viewer.editor().pose().rotation[joint::kRightElbow].y, .9, 1e-9);
    EXPECT_NEAR(viewer.editor().pose().rotation[joint::kLeftHip].x, -.7, 1e-9);
    if (const char* folder = getenv("DOPPEL_KEEP_SCREENS"))
        writeImage(fs::path(folder) / "kept-poses.png", screen_->grab(0, 0, 980, 740));

    // The next start has it, with another avatar too; a name, and gone.
    options.avatar = *folder_ / "avatar";
    PoseLibrary library(poses);
    ASSERT_EQ(library.poses().size(), 1u);
    EXPECT_EQ(library.poses()[0].pose.rotation, bent.rotation);
    clickItem("name of the pose");
    for (const char* key : {"End", "w", "n"}) {
        screen_->key(key);
        settle();
    }
    screen_->keyDown("Return");
    turn(2);
    screen_->keyUp("Return");
    settle();
    EXPECT_TRUE(fs::exists(poses / "pose 1wn.json")) << viewer.message();
    clickItem("forget");
    EXPECT_FALSE(fs::exists(poses / "pose 1wn.json"));
    EXPECT_TRUE(fs::exists(poses / "broken.json")) << "somebody else's";

    library.keep(bent, Betas{});
    EXPECT_EQ(library.keep(bent, Betas{}), 1u);
    for (const char* name : {"", "../up", ".hidden", "pose 1", "line\nbreak"})
        EXPECT_FALSE(messageOf<InputError>([&] { library.rename("pose 2", name); }).empty())
            << name;
    EXPECT_EQ(library.poses().size(), 2u);
    EXPECT_FALSE(messageOf<InputError>([&] { PoseLibrary("").keep(bent, Betas{}); }).empty());
}

// A program in the place of zenity or kdialog, which writes down its words and answers when it is
// told to.
class DialogTest : public ViewerTest {
protected:
    void SetUp() override {
        ViewerTest::SetUp();
        path_ = std::getenv("PATH");
        fs::create_directories(programs_.path());
        makeProgram("zenity");
        setenv("PATH", (programs_.path().string() + ":/usr/bin:/bin").c_str(), 1);
        unsetenv("XDG_CURRENT_DESKTOP");
    }
    void makeProgram(const std::string& name) {
        const fs::path program = programs_ / name;
        std::ofstream(program) << "#!/bin/sh\nhere=$(dirname \"$0\")\nprintf '%s\\n' \"$@\" > "
                                  "\"$here/words.part\"\nmv \"$here/words.part\" \"$here/words\"\n"
                                  "while ! [ -e \"$here/status\" ]; do sleep .02; done\n"
                                  "cat \"$here/answer\"\nexit \"$(cat \"$here/status\")\"\n";
        fs::permissions(program, fs::perms::owner_all);
    }
    void TearDown() override {
        setenv("PATH", path_.c_str(), 1);
        ViewerTest::TearDown();
    }
    // The dialog's words, one a line, once it is there.
    std::string words() {
        await("a dialog", [&] {
            viewer_->frame();
            return fs::exists(programs_ / "words");
        });
        std::string text = bytesOf(programs_ / "words");
        fs::remove(programs_ / "words");
        return text;
    }
    void answer(const std::string& name, int status = 0) {
        std::ofstream(programs_ / "answer") << name << "\n";
        std::ofstream(programs_ / "status.part") << status;
        fs::rename(programs_ / "status.part", programs_ / "status");
    }
    void untilAnswered(const std::function<bool()>& holds) {
        await("the answer", [&] {
            viewer_->frame();
            return holds();
        });
        fs::remove(programs_ / "status");
    }

    Folder programs_;
    std::string path_;
};

TEST_F(DialogTest, FilesAndFoldersAreChosen) {
    Viewer& viewer = openTab("Files");
    const fs::path named = *folder_ / "a name\nwith 'all' of it.npz";
    Motion motion = turningMotion(7);
    writeNpz(named, posesArrays(motion.theta, motion.trans, {}), false);
    clickItem("choose a file");
    std::string asked = words();
    EXPECT_EQ(asked.find("--file-selection\n--title=Open a motion"), 0u) << asked;
    EXPECT_EQ(asked.find("--directory"), std::string::npos);
    viewer.camera().yaw = .3;  // the window goes on
    settle();
    EXPECT_EQ(viewer.frameCount(), 1);
    answer(named.string());
    untilAnswered([&] { return viewer.frameCount() == 7; });

    // An avatar's folder, by keys.
    writeAvatar(*folder_ / "tall one", tallAvatar());
    screen_->keyDown("Shift_L");
    keyWith("Control_L", "o");
    screen_->keyUp("Shift_L");
    EXPECT_NE(words().find("--directory\n"), std::string::npos);
    answer((*folder_ / "tall one").string());
    untilAnswered([&] { return viewer.editor().betas()[0] == 3; });

    // Closed without a choice, and a name that is nothing's: nothing happens, or it is said.
    keyWith("Control_L", "o");
    words();
    const std::string said = viewer.message();
    answer("", 1);
    for (int i = 0; i < 20; ++i) {
        viewer.frame();
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    fs::remove(programs_ / "status");
    EXPECT_EQ(viewer.message(), said);
    keyWith("Control_L", "o");
    words();
    answer((*folder_ / "nothing.npz").string());
    untilAnswered([&] { return viewer.message().find("nothing.npz") != std::string::npos; });
    EXPECT_EQ(viewer.frameCount(), 7);

    // A new name; of one that is taken the window asks, as for one that is typed.
    clickItem("choose where to save");
    EXPECT_NE(words().find("--save\n"), std::string::npos);
    answer((*folder_ / "saved").string());
    untilAnswered([&] { return fs::exists(*folder_ / "saved.npz"); });
    EXPECT_EQ(readNpz(*folder_ / "saved.npz").at("transl").shape.at(0), 7);

    // The name of pictures and films.
    clickItem("choose a name");
    const std::string asks = words();
    EXPECT_NE(asks.find("--save\n"), std::string::npos);
    EXPECT_NE(asks.find("/doppel\n"), std::string::npos) << asks;
    answer((*folder_ / "a picture's name.png").string());
    untilAnswered([&] { return viewer.message().find("is named") != std::string::npos; });
    clickItem("picture");
    EXPECT_TRUE(fs::exists(*folder_ / "a picture's name.png")) << viewer.message();

    // A name that is chosen while the window asks something waits, as what is dropped does.
    viewer.editor().setKeyframe(2);
    clickItem("choose a file");
    words();
    screen_->closeWindow();
    settle();
    const std::string question = viewer.question();
    EXPECT_NE(question, "");
    answer(named.string());
    for (int i = 0; i < 20; ++i) {
        viewer.frame();
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    EXPECT_EQ(viewer.question(), question);
    viewer.answer("Cancel");
    untilAnswered([&] { return viewer.question().find("Opening") != std::string::npos; });
    viewer.answer("Do not save");
    settle();
    EXPECT_FALSE(viewer.editor().modified());

    // A window that is closed takes its dialog along.
    clickItem("choose a file");
    words();
    const auto began = std::chrono::steady_clock::now();
    viewer_.reset();
    EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(5));
}

// Whose dialog has other words, though zenity is there as well.
TEST_F(DialogTest, KdesDesktopHasItsOwn) {
    makeProgram("kdialog");
    setenv("XDG_CURRENT_DESKTOP", "ubuntu:KDE", 1);
    Viewer& viewer = openTab("Files");
    const fs::path named = *folder_ / "of kde.npz";
    const Motion motion = turningMotion(5);
    writeNpz(named, posesArrays(motion.theta, motion.trans, {}), false);
    const auto asks = [&](const char* title, const char* what) {
        const std::string asked = words();
        EXPECT_EQ(asked.find(fmt::format("--title\n{}", title)), 0u) << asked;
        EXPECT_NE(asked.find(fmt::format("\n{}\n/", what)), std::string::npos) << asked;
    };
    clickItem("choose a file");
    asks("Open a motion", "--getopenfilename");
    answer(named.string());
    untilAnswered([&] { return viewer.frameCount() == 5; });
    clickItem("choose a folder");
    asks("Open an avatar", "--getexistingdirectory");
    answer((*folder_ / "avatar").string());
    untilAnswered([&] { return viewer.message().find("the avatar avatar") == 0; });
    clickItem("choose where to save");
    asks("Save the poses", "--getsavefilename");
    answer((*folder_ / "by kde").string());
    untilAnswered([&] { return fs::exists(*folder_ / "by kde.npz"); });
}

TEST_F(DialogTest, WithoutAProgramTheButtonsSaySo) {
    fs::remove(programs_ / "zenity");
    setenv("PATH", programs_.path().c_str(), 1);
    ViewerOptions options;
    options.width = 980, options.height = 740;
    Viewer& viewer = open(options);
    keyWith("Control_L", "o");
    EXPECT_NE(viewer.message().find("install zenity or kdialog"), std::string::npos);
}

}  // namespace
}  // namespace doppel::test
