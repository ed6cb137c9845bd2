// The window: camera, panel, sizes, what goes wrong.
#include <sys/wait.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

TEST_F(ViewerTest, OrbitingKeepsTheTargetCentred) {
    Viewer& viewer = open();
    OrbitCamera before = viewer.camera();
    Image front = picture();
    drag({40, 380}, {180, 330}, 2);
    EXPECT_GT(std::abs(viewer.camera().yaw - before.yaw), 0.5);
    EXPECT_LT(viewer.camera().pitch, -0.1);
    EXPECT_EQ(viewer.camera().target, before.target);
    EXPECT_EQ(viewer.camera().distance, before.distance);
    const Pane& pane = viewer.panes().back();
    glm::dvec3 centre = projected(before.target, viewer.camera().view(),
                                  viewer.camera().camera(pane.width, pane.height));
    EXPECT_NEAR(centre.x, pane.width / 2.0, 1e-6);
    EXPECT_NEAR(centre.y, pane.height / 2.0, 1e-6);
    EXPECT_GT(difference(front, picture()), 0.05);
    expectScreen(picture(), "orbit");
    drag({40, 380}, {60, 380}, 3);  // pans
    EXPECT_NE(viewer.camera().target, before.target);
    double distance = viewer.camera().distance;
    screen_->click(4);
    settle();
    EXPECT_NEAR(viewer.camera().distance, 0.9 * distance, 1e-9);
    screen_->click(5);
    settle();
    EXPECT_NEAR(viewer.camera().distance, distance, 1e-9);
    // A touchpad scrolls sideways as well.
    glm::dvec3 target = viewer.camera().target;
    screen_->click(6);
    settle();
    EXPECT_GT(glm::distance(viewer.camera().target, target), 0.01);
    screen_->click(7);
    settle();
    EXPECT_NEAR(glm::distance(viewer.camera().target, target), 0, 1e-9);
    EXPECT_NEAR(viewer.camera().distance, distance, 1e-9);
}

TEST_F(ViewerTest, KeysLookFromTheSides) {
    Viewer& viewer = open();
    glm::dvec2 left = at(joint::kLeftWrist), right = at(joint::kRightWrist);
    EXPECT_GT(left.x, right.x + 50);  // facing us, her left is on our right
    screen_->key("3");
    settle();
    EXPECT_LT(std::abs(at(joint::kLeftWrist).x - at(joint::kRightWrist).x), 40);
    keyWith("Shift_L", "1");  // from behind
    EXPECT_LT(at(joint::kLeftWrist).x + 50, at(joint::kRightWrist).x);
    screen_->key("7");
    settle();
    EXPECT_LT(std::abs(at(joint::kHead).y - at(joint::kPelvis).y), 40);
    screen_->key("1");
    screen_->key("5");
    settle();
    EXPECT_TRUE(viewer.camera().orthographic);
    EXPECT_NEAR(at(joint::kLeftWrist).x, left.x, 12);
    expectScreen(picture(), "orthographic");
}

TEST_F(ViewerTest, ViewsAreKeptForTheNextStart) {
    ViewerOptions options;
    options.state = *folder_ / "kept-views";
    options.width = 800, options.height = 740;
    Viewer& viewer = open(options);
    auto keep = [&](const std::string& digit) {
        screen_->keyDown("Shift_L");
        keyWith("Control_L", digit);
        screen_->keyUp("Shift_L");
        settle();
    };
    drag({40, 380}, {180, 330}, 2);
    const std::string aside = cameraText(viewer.camera());
    keep("2");
    screen_->key("1");
    screen_->key("5");
    settle();
    const std::string front = cameraText(viewer.camera());
    ASSERT_NE(aside, front);
    keep("9");
    keyWith("Control_L", "2");
    EXPECT_EQ(cameraText(viewer.camera()), aside);
    keyWith("Control_L", "4");
    EXPECT_NE(viewer.message().find("no view 4"), std::string::npos) << viewer.message();
    EXPECT_EQ(cameraText(viewer.camera()), aside);

    viewer_.reset();
    Viewer& next = open(options);
    keyWith("Control_L", "9");
    EXPECT_EQ(cameraText(next.camera()), front);
    screen_->key("n");
    settle();
    clickItem("see 2");
    EXPECT_EQ(cameraText(next.camera()), aside);
    clickItem("name of 2");
    for (const char* key : {"End", "w", "n"}) {
        screen_->key(key);
        settle();
    }
    screen_->key("Return");
    settle();
    EXPECT_EQ(next.preferences().bookmarks.at(2).name, "view 2wn");
    EXPECT_FALSE(next.settings().wireframe) << "it was typed";
    clickItem("keep this view");
    EXPECT_EQ(readPreferences(options.state).bookmarks.at(1).camera, aside) << "the first free one";
    clickItem("forget");  // of the last
    const Preferences left = readPreferences(options.state);
    EXPECT_EQ(left, next.preferences());
    EXPECT_EQ(left.bookmarks.size(), 2u);
    EXPECT_EQ(left.bookmarks.at(2).name, "view 2wn");
    EXPECT_EQ(left.bookmarks.at(2).camera, aside) << "as --camera takes it";
}

TEST_F(ViewerTest, ThePanelOpensAndDoesNotOrbit) {
    Viewer& viewer = open();
    screen_->key("n");
    settle();
    ASSERT_TRUE(viewer.settings().panel);
    const Pane& pane = viewer.panes().back();
    EXPECT_EQ(pane.width, kWidth - viewer.panelWidth());
    double yaw = viewer.camera().yaw;
    const glm::dvec2 free = itemAt("Files") + glm::dvec2(40, 0);
    drag(free, free + glm::dvec2(60, 0));
    EXPECT_EQ(viewer.camera().yaw, yaw);
    EXPECT_FALSE(viewer.settings().wireframe);
    clickItem("wireframe");
    EXPECT_TRUE(viewer.settings().wireframe);
}

// While the mouse rests nothing is drawn; what is open, held or typed into stays so.
TEST_F(ViewerTest, RemembersItsPanelWhileTheMouseRests) {
    Viewer& viewer = open();
    screen_->key("n");
    settle();
    ASSERT_TRUE(viewer.settings().panel);
    auto restAt = [&](glm::dvec2 place) {
        screen_->move(place.x, place.y);
        rest();
    };
    auto clickAt = [&](const std::string& label) {
        restAt(itemAt(label));
        screen_->press(1);
        rest();
        screen_->release(1);
        rest();
    };
    clickAt("wireframe");
    EXPECT_TRUE(viewer.settings().wireframe) << "a box";
    clickAt("wireframe");
    EXPECT_FALSE(viewer.settings().wireframe) << "a box";

    clickAt("surface");
    clickAt("normals");
    EXPECT_EQ(viewer.settings().paint, kPaintNormals) << "an open list";

    // Escape closes a list, and only that.
    const auto lists = [&](const char* row) {
        return std::ranges::count(drawnItems(), row, &DrawnItem::label) > 0;
    };
    const std::optional<size_t> selected = viewer.selected();
    clickAt("surface");
    EXPECT_TRUE(lists("UV checker"));
    screen_->key("Escape");
    rest();
    EXPECT_FALSE(lists("UV checker"));
    EXPECT_EQ(viewer.settings().paint, kPaintNormals);
    EXPECT_EQ(viewer.selected(), selected);

    clickAt("Files");
    clickAt("path");
    for (const char* key : {"w", "n", "h", "5"}) {
        screen_->key(key);
        rest();
    }
    EXPECT_FALSE(viewer.settings().wireframe) << "the path's field";
    EXPECT_TRUE(viewer.settings().panel) << "the path's field";
    EXPECT_FALSE(viewer.settings().help) << "the path's field";
    EXPECT_FALSE(viewer.camera().orthographic) << "the path's field";
    screen_->key("Return");  // opens what was typed, as the button does
    rest();
    EXPECT_NE(viewer.message().find("wnh5"), std::string::npos) << viewer.message();

    const glm::dvec2 slider = {100, itemAt("frame").y};
    restAt(slider);
    screen_->press(1);
    rest();
    double began = viewer.timeline();
    EXPECT_GT(began, 5);
    restAt(slider + glm::dvec2(200, 0));
    EXPECT_NEAR(viewer.timeline() - began, 120 * 200 / (kWidth - 16.0), 3) << "a held slider";
    screen_->release(1);
    rest();
}

TEST_F(ViewerTest, WhatIsUnderTheHelpStaysWhereItIs) {
    Viewer& viewer = open();
    screen_->key("h");
    glm::dvec2 wrist = at(joint::kLeftWrist);
    screen_->move(wrist.x, wrist.y);
    rest();
    ASSERT_TRUE(viewer.settings().help);
    Pose before = viewer.editor().pose();
    OrbitCamera camera = viewer.camera();
    screen_->press(1);
    for (int i = 1; i <= 4; ++i) {
        screen_->move(wrist.x - 10 * i, wrist.y);
        rest();
    }
    screen_->release(1);
    rest();
    EXPECT_EQ(viewer.editor().pose(), before);
    EXPECT_FALSE(viewer.editor().canUndo());
    EXPECT_EQ(viewer.camera().yaw, camera.yaw);
}

TEST_F(ViewerTest, WorksOnlyWhenSomethingChanged) {
    Viewer& viewer = open();
    uint64_t pictures = viewer.pictureCount();
    turn(3);
    EXPECT_EQ(viewer.pictureCount(), pictures);
    screen_->move(20, 20);  // away from everything
    settle();
    EXPECT_LE(viewer.pictureCount(), pictures);
    viewer.camera().yaw = 0.4;
    settle();
    EXPECT_GT(viewer.pictureCount(), pictures);
}

TEST_F(ViewerTest, SurvivesResizingHidingAndALostSwapchain) {
    Viewer& viewer = open();
    viewer.settings().joints = false;  // which show while the mouse is in the window
    settle();
    Image before = picture();
    int swapchains = viewer.window().swapchainCount();
    screen_->resizeWindow(800, 600);
    settle();
    EXPECT_EQ(viewer.window().width(), 800);
    EXPECT_EQ(viewer.panes().back().height, 600 - Viewer::kTimelineHeight);
    EXPECT_GT(viewer.window().swapchainCount(), swapchains);
    EXPECT_GT(shareOfAvatar(screen_->grab(0, 0, 800, 500)), 0.02);
    for (auto [width, height] :
         {std::pair{1, 1}, {3, 700}, {400, 20}, {220, 160}, {kWidth, kHeight}}) {
        screen_->resizeWindow(width, height);
        turn(6);
    }
    settle();
    screen_->hideWindow();
    turn(4);
    screen_->showWindow();
    settle();
    viewer.window().loseSwapchain();
    viewer.camera().yaw = 0.2;
    settle();
    viewer.camera().yaw = 0;
    screen_->key("Home");
    settle();
    EXPECT_LT(difference(picture(), before), 0.002);
}

TEST_F(ViewerTest, ASecondWindowAndAFailingMachine) {
    Viewer& viewer = open();
    fs::path program = fs::read_symlink("/proc/self/exe").parent_path() / "doppel";
    std::string avatar = (*folder_ / "avatar").string();
    // Its panel is where nothing else is on the screen.
    constexpr int kSecondWidth = 900;
    auto panel = [&] {
        return screen_->grab(kSecondWidth - Viewer::kPanelWidth, 0, Viewer::kPanelWidth, 300);
    };
    Image nothing = panel();
    pid_t second = fork();
    if (second == 0) {
        std::string size = fmt::format("{}x400", kSecondWidth);
        execl(program.c_str(), program.c_str(), "view", avatar.c_str(), "--size", size.c_str(),
              nullptr);
        _exit(127);
    }
    auto awaitSecond = [&](const std::string& what, const std::function<bool()>& holds) {
        await("the second window " + what, [&] {
            viewer.frame();
            return holds() || waitpid(second, nullptr, WNOHANG) != 0;
        });
    };
    awaitSecond("to show its panel", [&] { return difference(panel(), nothing) > 0.02; });
    Image shown = panel();
    screen_->move(kSecondWidth - 20, 390);
    screen_->key("n");
    awaitSecond("to close its panel", [&] { return difference(panel(), shown) > 0.5; });
    Image closed = panel();
    screen_->key("n");
    awaitSecond("to open its panel", [&] { return difference(panel(), closed) > 0.5; });
    EXPECT_EQ(kill(second, SIGTERM), 0) << "the second one has ended";
    waitpid(second, nullptr, 0);

    // A lost device looks like this to the loop.
    Pose pose = viewer.editor().pose();
    pose.rotation[joint::kHead] = {0, 0.25, 0};
    viewer.editor().setPose(pose);
    fs::path here = fs::current_path();
    fs::current_path(folder_->path());
    std::string message = messageOf<MachineError>(
        [&] { viewer.run([] { throwMachine("vkQueueSubmit: VK_ERROR_DEVICE_LOST"); }); });
    EXPECT_NE(message.find("VK_ERROR_DEVICE_LOST"), std::string::npos);
    EXPECT_NE(message.find("doppel-pose-1.json"), std::string::npos);
    viewer_.reset();
    ViewerOptions options;
    options.pose = "doppel-pose-1.json";
    EXPECT_NEAR(open(options).editor().pose().rotation[joint::kHead].y, 0.25, 1e-6);
    fs::current_path(here);
}

// The window compiles no shader, so the widest vectors do not harm it (viewer/window/swapchain.h).
TEST_F(ViewerTest, TheWidestVectorsShowTheSame) {
    fs::path program = fs::read_symlink("/proc/self/exe");
    const char* driver = getenv("VK_DRIVER_FILES");
    if (!driver || !std::string_view(driver).ends_with("/build/mesa/lvp_icd.json"))
        GTEST_SKIP() << "other drivers than Mesa 25's lavapipe do not stand 512 bits";
    pid_t wide = fork();
    if (wide == 0) {
        setenv("LP_NATIVE_VECTOR_WIDTH", "512", 1);
        unsetenv("DOPPEL_KERNEL_LOG");  // which is this process's
        execl(program.c_str(), program.c_str(),
              "--gtest_filter=ViewerTest.ThePanel*:ViewerTest.KeysLook*", nullptr);
        _exit(127);
    }
    int status = 0;
    waitpid(wide, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}

TEST_F(ViewerTest, AClickIntoTheEmptyDeselectsAndAnOrbitDoesNot) {
    Viewer& viewer = open();
    glm::dvec2 elbow = at(joint::kLeftElbow);
    auto select = [&] {
        screen_->move(elbow.x, elbow.y);
        turn();
        screen_->click(1);
        settle();
        ASSERT_EQ(viewer.selected(), size_t{joint::kLeftElbow});
    };
    select();
    drag({30, 380}, {80, 380});
    EXPECT_TRUE(viewer.selected());
    viewer.camera().yaw = 0;
    settle();
    screen_->move(30, 380);
    turn();
    screen_->click(1);
    settle();
    EXPECT_FALSE(viewer.selected());
    // F sees the joint, Home all of the body.
    double all = viewer.camera().distance;
    select();
    screen_->key("f");
    settle();
    EXPECT_LT(viewer.camera().distance, .6 * all);
    const Pane& pane = viewer.panes().back();
    for (size_t j : {joint::kLeftElbow, joint::kLeftWrist}) {
        EXPECT_GT(at(j).x, 0);
        EXPECT_LT(at(j).x, pane.width);
        EXPECT_GT(at(j).y, 0);
        EXPECT_LT(at(j).y, pane.height);
    }
    screen_->key("Home");
    settle();
    EXPECT_NEAR(viewer.camera().distance, all, .1 * all);
}

TEST_F(ViewerTest, TheWheelGoesToWhatIsUnderTheMouse) {
    open();
    glm::dvec2 wrist = at(joint::kLeftWrist);
    double head = glm::distance(at(joint::kHead), wrist);
    screen_->move(wrist.x, wrist.y);
    turn();
    for (int i = 0; i < 4; ++i) screen_->click(4);
    settle();
    EXPECT_LT(glm::distance(at(joint::kLeftWrist), wrist), 6);
    EXPECT_GT(glm::distance(at(joint::kHead), at(joint::kLeftWrist)), 1.3 * head);
    for (int i = 0; i < 4; ++i) screen_->click(5);
    settle();
    EXPECT_NEAR(glm::distance(at(joint::kHead), at(joint::kLeftWrist)), head, 1);
}

TEST_F(ViewerTest, MessagesGoByThemselvesAndAreKept) {
    Viewer& viewer = open();
    keyWith("Control_L", "c");
    EXPECT_EQ(viewer.visibleMessages(), 1u);
    Image with = picture();
    await("the message to go", [&] {
        viewer.frame();
        return viewer.visibleMessages() == 0;
    });
    settle();
    EXPECT_GT(difference(with, picture()), 0.001) << "it is gone from the picture";
    EXPECT_EQ(viewer.message(), "pose copied");
    viewer.settings().panel = true;
    settle();
    clickItem("Files");
    clickItem("messages");
    EXPECT_TRUE(std::ranges::count(drawnItems(), "pose copied", &DrawnItem::label) == 1)
        << "and in the history";
}

TEST_F(ViewerTest, TheCameraIsCopiedAsTheCommandTakesIt) {
    Viewer& viewer = open();
    viewer.camera().yaw = .5;
    viewer.camera().pitch = -.25;
    viewer.camera().target = {.1, -.2, 3};
    viewer.camera().orthographic = true;
    settle();
    const OrbitCamera before = viewer.camera();
    screen_->keyDown("Control_L");
    keyWith("Shift_L", "c");
    screen_->keyUp("Control_L");
    const std::string text = viewer.window().clipboard();
    ASSERT_TRUE(text.starts_with("--camera ")) << text;
    screen_->key("1");
    screen_->key("5");
    settle();
    screen_->keyDown("Control_L");
    keyWith("Shift_L", "v");
    screen_->keyUp("Control_L");
    settle();
    auto expectBefore = [&](const OrbitCamera& camera) {
        EXPECT_NEAR(camera.yaw, before.yaw, 1e-6);
        EXPECT_NEAR(camera.pitch, before.pitch, 1e-6);
        EXPECT_NEAR(camera.distance, before.distance, 1e-6);
        EXPECT_NEAR(glm::distance(camera.target, before.target), 0, 1e-5);
        EXPECT_NEAR(camera.fieldOfView, before.fieldOfView, 1e-6);
        EXPECT_TRUE(camera.orthographic);
    };
    expectBefore(viewer.camera());
    expectBefore(readCameraText(text.substr(9)));
    // For other programs: where a point is on the picture.
    const std::string json = cameraJson(before, 300, 200);
    expectBefore(readCameraText(json));
    const auto read = nlohmann::json::parse(json);
    const glm::dvec3 point(.3, .1, 2.8);
    const glm::dvec3 expected = projected(point, before.view(), before.camera(300, 200));
    glm::dvec3 seen(0);
    for (int row = 0; row < 3; ++row)
        for (int k = 0; k < 4; ++k)
            seen[row] +=
                read["extrinsic"][size_t(row)][size_t(k)].get<double>() * (k < 3 ? point[k] : 1);
    for (int k = 0; k < 2; ++k) {
        const auto& intrinsic = read["intrinsic"][size_t(k)];
        EXPECT_NEAR(
            intrinsic[size_t(k)].get<double>() * seen[k] / seen.z + intrinsic[2].get<double>(),
            expected[k], 1e-6);
    }
    for (const char* wrong : {"", "1,2,3", "1,2,-3,0,0,0,40", "1,2,3,0,0,0,40,wide",
                              "nan,2,3,0,0,0,40", "1,2,3,0,0,1e9,40", "1,2,3,0,0,0,40,"})
        EXPECT_NE(messageOf<InputError>([&] { readCameraText(wrong); }).find("camera: expected"),
                  std::string::npos)
            << wrong;
}

TEST_F(ViewerTest, TheWindowHasTheApplicationsIcon) {
    open();
    const Image icon = screen_->icon();
    ASSERT_EQ(icon.width, 64);
    EXPECT_EQ(icon.pixel(0, 0)[3], 0) << "round corners";
    const auto colour = [&](int x, int y) {
        const uint8_t* p = icon.pixel(x, y);
        return fmt::format("{:02x}{:02x}{:02x} {}", p[0], p[1], p[2], p[3]);
    };
    EXPECT_EQ(colour(24, 16), "f2c79b 255") << "the person's head";
    EXPECT_EQ(colour(24, 32), "f2c79b 255") << "and chest";
    EXPECT_EQ(colour(56, 56), "22303c 255");
    const uint8_t* mesh = icon.pixel(40, 12);
    EXPECT_GT(int(mesh[2]), int(mesh[0]) + 50) << "the double's mesh";
}

TEST_F(ViewerTest, SaysWhatIsWrong) {
    ViewerOptions options;
    options.avatar = *folder_ / "nobody";
    options.width = 300, options.height = 300;
    EXPECT_NE(messageOf<InputError>([&] { Viewer viewer(options); }).find("avatar.toml"),
              std::string::npos);
    Viewer& viewer = open();
    viewer.window().setClipboard("{\"doppel_pose\": 1, \"joints\": {\"left_wing\": [0, 0, 0]}}");
    keyWith("Control_L", "v");
    EXPECT_NE(viewer.message().find("left_wing"), std::string::npos);
    EXPECT_FALSE(viewer.editor().canUndo());
    keyWith("Control_L", "c");
    EXPECT_NE(viewer.window().clipboard().find("left_wrist"), std::string::npos);
}

}  // namespace
}  // namespace doppel::test
