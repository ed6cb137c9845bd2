// What the panel and the timeline say and switch, as who uses the window meets it.
#include <imgui.h>

#include <nlohmann/json.hpp>

#include "tests/viewer_test.h"
#include "viewer/overlays.h"
#include "viewer/pose/balance.h"

namespace doppel::test {
namespace {

class ControlsTest : public ViewerTest {
protected:
    fs::path motionFile(const std::string& name, size_t frames, double fps) {
        const Motion motion = turningMotion(frames);
        Npz npz = posesArrays(motion.theta, motion.trans, {});
        npz.set("fps", Array::scalarF64(fps));
        writeNpz(*folder_ / name, npz, false);
        return *folder_ / name;
    }
    // The largest difference of two poses' rotations, radians.
    static double furthest(const Pose& a, const Pose& b) {
        double most = 0;
        for (size_t j = 0; j < joint::kCount; ++j)
            most = std::max(most, glm::distance(a.rotation[j], b.rotation[j]));
        return most;
    }
    bool shows(const std::string& words) {
        return std::ranges::count(drawnItems(), words, &DrawnItem::label) > 0;
    }
};

TEST_F(ControlsTest, TheClockSaysFrameAndSeconds) {
    struct Case {
        size_t frames;
        double fps;
        const char *frame, *says;
    };
    for (const Case& c : {Case{48, 25, "26", "26 / 47   1.04 s / 1.88 s   25 fps"},
                          {48, 29.97, "0", "0 / 47   0.00 s / 1.57 s   29.97 fps"},
                          {1501, 20, "1246", "1246 / 1500   1:02.3 / 1:15.0   20 fps"}}) {
        ViewerOptions options;
        options.motion = motionFile("clock.npz", c.frames, c.fps);
        openTab("View", options);
        typeInto("frame", c.frame);
        EXPECT_TRUE(shows(c.says)) << c.says;
        viewer_.reset();
    }
    // A narrow window has room for less.
    ViewerOptions options;
    options.motion = motionFile("clock.npz", 48, 25);
    options.width = 400, options.height = 400;
    open(options);
    EXPECT_TRUE(shows("0 / 47"));
}

TEST_F(ControlsTest, WhatWasOpenedBeforeIsOpenedByAClick) {
    const fs::path walk = motionFile("walk.npz", 5, 30), run = motionFile("run.npz", 7, 30);
    Viewer& viewer = openTab("Files");
    dropOnWindow({walk, run});
    EXPECT_EQ(viewer.frameCount(), 7);
    clickItem("opened before");
    EXPECT_LT(itemAt("run.npz").y, itemAt("walk.npz").y) << "the latest comes first";
    clickItem("walk.npz");
    EXPECT_EQ(viewer.frameCount(), 5) << viewer.message();
    EXPECT_LT(itemAt("walk.npz").y, itemAt("run.npz").y);
    std::ofstream(*folder_ / "wave.json")
        << R"({"doppel_pose": 1, "joints": {"left_wrist": [0.5, 0, -1]}})";
    dropOnWindow({*folder_ / "wave.json"});
    EXPECT_LT(itemAt("wave.json").y, itemAt("walk.npz").y);
    keyWith("Control_L", "z");
    settle();
    const Pose before = viewer.editor().pose();
    clickItem("wave.json");
    EXPECT_NE(viewer.editor().pose(), before);
    fs::remove(run);
    clickItem("run.npz");
    EXPECT_EQ(viewer.frameCount(), 5);
    EXPECT_NE(viewer.message().find("run.npz"), std::string::npos) << viewer.message();
}

TEST_F(ControlsTest, JointLimitsHoldUntilTheyAreSwitchedOff) {
    Viewer& viewer = openTab("Pose");
    const auto degrees = [&] {
        return glm::degrees(viewer.editor().pose().rotation[joint::kHead].x);
    };
    clickItem("head");
    typeInto("x", "150");
    const double held = degrees();
    EXPECT_GT(held, 10);
    EXPECT_LT(held, 60);
    clickItem("undo");
    clickItem("joint limits");
    EXPECT_FALSE(viewer.settings().limits);
    typeInto("x", "150");
    EXPECT_NEAR(degrees(), 150, .1);
    // Back within them, a further edit may not go beyond what is there.
    clickItem("joint limits");
    typeInto("x", "170");
    EXPECT_LT(degrees(), 150.1);
}

TEST_F(ControlsTest, BalanceHoldsThePinnedBodyUnlessItIsSwitchedOff) {
    Viewer& viewer = openTab("Pose");
    const std::array<size_t, 2> feet{joint::kLeftAnkle, joint::kRightAnkle};
    for (const size_t foot : feet) {
        const glm::dvec2 place = at(foot);
        screen_->move(place.x, place.y);
        turn();
        screen_->key("p");
        settle();
    }
    const glm::dvec2 hand = at(joint::kLeftWrist);
    const auto pulled = [&] {
        drag(hand, hand + glm::dvec2(90, 40));
        const double out = outOfBalance(viewer.posed(), feet);
        clickItem("undo");
        return out;
    };
    const double balanced = pulled();
    clickItem("balance over pins");
    EXPECT_FALSE(viewer.settings().balance);
    EXPECT_GT(pulled(), balanced + .01);
    EXPECT_LT(balanced, .01);
}

TEST_F(ControlsTest, TheNumpadsPointShowsTheSelectedJoint) {
    Viewer& viewer = open();
    const glm::dvec2 wrist = at(joint::kLeftWrist);
    screen_->move(wrist.x, wrist.y);
    turn();
    screen_->click(1);
    settle();
    ASSERT_EQ(viewer.selected(), size_t{joint::kLeftWrist});
    const double before = viewer.camera().distance;
    screen_->key("KP_Decimal");
    settle();
    const glm::dvec2 middle(kWidth / 2., (kHeight - Viewer::kTimelineHeight) / 2.);
    EXPECT_LT(glm::distance(at(joint::kLeftWrist), middle), 60);
    EXPECT_LT(viewer.camera().distance, before / 2);
    // F and Home do the same and bring all of it back.
    screen_->key("Home");
    settle();
    EXPECT_NEAR(viewer.camera().distance, before, .02 * before);
    screen_->key("f");
    settle();
    EXPECT_LT(glm::distance(at(joint::kLeftWrist), middle), 60);
}

TEST_F(ControlsTest, TheCameraIsCopiedAsJsonAndPasted) {
    Viewer& viewer = openTab("View");
    viewer.camera().yaw = .7;
    viewer.camera().pitch = -.2;
    settle();
    clickItem("copy as JSON");
    const std::string text = viewer.window().clipboard();
    const auto json = nlohmann::json::parse(text);
    const Pane& pane = viewer.panes().back();
    EXPECT_EQ(json["width"], pane.viewWidth) << text;
    EXPECT_EQ(json["height"], pane.height) << text;
    EXPECT_EQ(json["camera"], cameraText(viewer.camera())) << text;
    screen_->key("1");
    settle();
    EXPECT_EQ(viewer.camera().yaw, 0);
    clickItem("paste camera");
    EXPECT_NEAR(viewer.camera().yaw, .7, 1e-6);
    EXPECT_NEAR(viewer.camera().pitch, -.2, 1e-6);
}

// As --camera names it; it is what is copied again.
TEST_F(ControlsTest, BeginsWithTheCameraThatIsNamed) {
    Viewer& first = openTab("View");
    first.camera().yaw = .7;
    first.camera().pitch = -.2;
    first.camera().distance *= .6;
    settle();
    clickItem("copy camera");
    ViewerOptions options;
    options.avatar = *folder_ / "avatar";
    options.camera = first.window().clipboard();
    Viewer& viewer = viewer_.emplace(options);
    settle();
    EXPECT_EQ("--camera " + cameraText(viewer.camera()), options.camera);
    options.camera = "yaw of a camera";
    viewer_.reset();
    EXPECT_NE(messageOf<InputError>([&] { Viewer wrong(options); }).find("camera"),
              std::string::npos);
}

TEST_F(ControlsTest, APoseIsPastedMirrored) {
    Viewer& viewer = openTab("Pose");
    const Pose straight = viewer.editor().pose();
    const glm::dvec2 wrist = at(joint::kLeftWrist);
    drag(wrist, wrist + glm::dvec2(-20, -60));
    const Pose raised = viewer.editor().pose();
    keyWith("Control_L", "c");
    keyWith("Control_L", "z");
    settle();
    screen_->keyDown("Alt_L");
    keyWith("Control_L", "v");
    screen_->keyUp("Alt_L");
    settle();
    const Pose pasted = viewer.editor().pose(), expected = mirrored(raised);
    EXPECT_GT(furthest(straight, expected), .1);
    EXPECT_LT(furthest(pasted, expected), 1e-5);
    keyWith("Control_L", "z");
    settle();
    EXPECT_LT(furthest(viewer.editor().pose(), straight), 1e-5);
}

// What is seen through the capture's camera is not the view that would be copied.
TEST_F(ControlsTest, OnlyAViewThatIsSeenIsCopied) {
    ViewerOptions options;
    options.motion = *folder_ / "recorded";
    writeColouredCapture(options.motion, turningMotion(2));
    Viewer& viewer = openTab("View", options);
    const auto copies = [&](const std::function<void()>& copy) {
        viewer.window().setClipboard("before");
        copy();
        settle();
        return viewer.window().clipboard() != "before";
    };
    const std::vector<std::function<void()>> ways{[&] {
                                                      screen_->keyDown("Control_L");
                                                      keyWith("Shift_L", "c");
                                                      screen_->keyUp("Control_L");
                                                  },
                                                  [&] { clickItem("copy camera"); },
                                                  [&] { clickItem("copy as JSON"); }};
    for (const auto& copy : ways) {
        viewer.settings().captureCamera = false;
        settle();
        EXPECT_TRUE(copies(copy));
        viewer.settings().captureCamera = true;
        settle();
        EXPECT_FALSE(copies(copy));
        EXPECT_NE(viewer.message().find("the viewer's own camera"), std::string::npos)
            << viewer.message();
    }
}

// The floor's lines are lighter than this background, so that what is darker is the shadow.
TEST_F(ControlsTest, TheBodyThrowsAContactShadow) {
    Viewer& viewer = open();
    viewer.settings().joints = false;
    viewer.settings().colour = {.4f, .4f, .4f};
    drag({20, 60}, {20, 140}, 2);
    settle();
    const Image without = picture();
    screen_->key("g");
    settle();
    const Image with = picture();
    glm::dvec2 sum(0);
    size_t darker = 0;
    for (int y = 0; y < with.height; ++y)
        for (int x = 0; x < 360; ++x)  // the scale is to the right
            if (with.pixel(x, y)[1] + 4 < without.pixel(x, y)[1]) sum += glm::dvec2(x, y), ++darker;
    ASSERT_GT(darker, 200u) << "the shadow";
    const glm::dvec2 soles = (at(joint::kLeftFoot) + at(joint::kRightFoot)) / 2.;
    EXPECT_LT(glm::distance(sum / double(darker), soles), 30) << "where the feet stand";
    if (const char* folder = getenv("DOPPEL_KEEP_SCREENS"))
        writeImage(fs::path(folder) / "contact-shadow.png", with);
}

// Also where the joint is at the picture's edge.
TEST_F(ControlsTest, TheJointsNameIsReadBesideTheMouse) {
    Viewer& viewer = open();
    const auto white = [&](glm::dvec2 mouse) {
        screen_->move(mouse.x, mouse.y);
        settle();
        const Image seen = picture();
        int count = 0;
        for (int y = std::max(0, int(mouse.y) - 26); y < int(mouse.y) + 20; ++y)
            for (int x = std::max(0, int(mouse.x) - 110);
                 x < std::min(seen.width, int(mouse.x) + 110); ++x)
                count += *std::min_element(seen.pixel(x, y), seen.pixel(x, y) + 3) > 200;
        return count;
    };
    const glm::dvec2 wrist = at(joint::kLeftWrist);
    const int free = white(wrist);
    EXPECT_GT(free, 20) << "its letters";
    const OrbitCamera camera = viewer.camera();
    for (const glm::dvec2 edge : {glm::dvec2(kWidth - 12, 200), glm::dvec2(300, 5)}) {
        viewer.camera() = camera;
        viewer.camera().pan(edge.x - wrist.x, edge.y - wrist.y, viewer.panes()[0].height);
        settle();
        EXPECT_NEAR(white(at(joint::kLeftWrist)), free, .35 * free) << edge.x << ", " << edge.y;
    }
}

TEST_F(ControlsTest, TheTipsOfUndoAndRedoNameTheStep) {
    Viewer& viewer = openTab("Pose");
    const glm::dvec2 wrist = at(joint::kLeftWrist);
    drag(wrist, wrist - glm::dvec2(0, 40));
    const auto expectTip = [&](const std::string& button, const std::string& words) {
        const glm::dvec2 place = itemAt(button);
        screen_->move(place.x, place.y);
        await(words, [&] {
            viewer.frame();
            return shows(words) && !tipPending();
        });
    };
    expectTip("undo", "Takes the last edit back: move left wrist (Ctrl + Z).");
    clickItem("undo");
    expectTip("redo", "Makes it again: move left wrist (Ctrl + Shift + Z).");
}

// Whoever turns a joint in the panel looks for it on the body.
TEST_F(ControlsTest, JointsStayVisibleWhileThePanelIsUsed) {
    Viewer& viewer = openTab("Pose");
    clickItem("head");
    const auto expectHandles = [&](const std::string& when) {
        const Image seen = picture();
        struct Handle {
            size_t joint;
            ImU32 colour;
            double
                aside;  // a ring that is seen from its edge goes through the selected one's middle
        };
        for (const auto& [joint, colour, aside] :
             {Handle{joint::kHead, kSelectedColour, 4}, {joint::kLeftKnee, kJointColour, 0}}) {
            const glm::dvec2 place = at(joint) - glm::dvec2(aside, 0);
            const uint8_t* rgb = seen.pixel(int(place.x), int(place.y));
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(rgb[c], (colour >> 8 * c) & 0xff, 12)
                    << jointName(joint) << " " << when;
        }
    };
    const glm::dvec2 slider = itemAt("x");
    screen_->move(slider.x, slider.y);
    turn();
    expectHandles("under a mouse that is over the panel");
    const Pose before = viewer.editor().pose();
    screen_->press(1);
    turn();
    screen_->move(slider.x + 25, slider.y);
    turn();
    EXPECT_NE(viewer.editor().pose(), before);
    expectHandles("while a slider is held");
    screen_->release(1);
    settle();
    expectHandles("after it");
}

}  // namespace
}  // namespace doppel::test
