// Keys and the mouse: two presets, a file of the user's, and drags that a key begins.
#include <algorithm>
#include <fstream>

#include "engine/error.h"
#include "tests/viewer_test.h"
#include "viewer/keys/bindings.h"

namespace doppel::test {
namespace {

void write(const fs::path& file, const std::string& text) { std::ofstream(file) << text; }

class KeysTest : public ViewerTest {
protected:
    Viewer& openWith(const std::string& keys) {
        ViewerOptions options;
        options.keys = keys;
        return open(options);
    }
    void heldDrag(const std::vector<std::string>& held, glm::dvec2 from, glm::dvec2 to,
                  int button) {
        for (const std::string& key : held) screen_->keyDown(key);
        drag(from, to, button);
        for (const std::string& key : held) screen_->keyUp(key);
        settle();
    }
};

TEST_F(KeysTest, BlendersMouse) {
    Viewer& viewer = openWith("blender");
    const OrbitCamera first = viewer.camera();
    drag({40, 380}, {180, 330}, 2);
    EXPECT_NE(viewer.camera().yaw, first.yaw);
    heldDrag({"Shift_L"}, {40, 380}, {60, 380}, 2);
    EXPECT_NE(viewer.camera().target, first.target);
    EXPECT_EQ(viewer.camera().distance, first.distance);
    heldDrag({"Control_L"}, {40, 380}, {40, 340}, 2);
    EXPECT_LT(viewer.camera().distance, first.distance);
    const OrbitCamera before = viewer.camera();
    drag({40, 380}, {60, 380}, 3);
    EXPECT_EQ(cameraText(viewer.camera()), cameraText(before)) << "the right button pans nothing";
    // Two buttons do: Alt makes a middle one of the left one, over joints as well.
    const Pose pose = viewer.editor().pose();
    heldDrag({"Alt_L"}, at(joint::kLeftWrist), at(joint::kLeftWrist) + glm::dvec2(40, 0), 1);
    EXPECT_NE(viewer.camera().yaw, before.yaw);
    const glm::dvec3 target = viewer.camera().target;
    heldDrag({"Alt_L", "Shift_L"}, {40, 380}, {60, 380}, 1);
    EXPECT_NE(viewer.camera().target, target);
    const double distance = viewer.camera().distance;
    heldDrag({"Alt_L", "Control_L"}, {40, 380}, {40, 340}, 1);
    EXPECT_LT(viewer.camera().distance, distance);
    EXPECT_EQ(viewer.editor().pose(), pose);
}

TEST_F(KeysTest, BlendersKeys) {
    Viewer& viewer = openWith("blender");
    screen_->key("KP_3");
    settle();
    EXPECT_NEAR(viewer.camera().yaw, std::acos(0.), 1e-9);
    keyWith("Control_L", "KP_1");
    EXPECT_NEAR(std::abs(viewer.camera().yaw), 2 * std::acos(0.), 1e-9);
    screen_->key("9");
    settle();
    EXPECT_NEAR(viewer.camera().yaw, 0, 1e-9);
    screen_->key("6");
    screen_->key("8");
    settle();
    EXPECT_NEAR(viewer.camera().yaw, std::acos(0.) / 6, 1e-9);
    EXPECT_NEAR(viewer.camera().pitch, std::acos(0.) / 6, 1e-9);
    screen_->key("1");
    settle();
    keyWith("Shift_L", "z");
    EXPECT_TRUE(viewer.settings().wireframe);

    screen_->key("i");
    settle();
    ASSERT_EQ(viewer.editor().keyframes().size(), 1u);
    for (int i = 0; i < 4; ++i) {
        screen_->key("Right");
        settle();
    }
    screen_->key("i");
    settle();
    EXPECT_EQ(viewer.editor().keyframes().size(), 2u);
    EXPECT_EQ(viewer.timeline(), 4);
    screen_->key("Down");
    settle();
    EXPECT_EQ(viewer.timeline(), 0);
    screen_->key("Up");
    settle();
    EXPECT_EQ(viewer.timeline(), 4);
    screen_->key("Up");
    settle();
    EXPECT_NE(viewer.message().find("no key after"), std::string::npos) << viewer.message();
    keyWith("Shift_L", "Left");
    EXPECT_EQ(viewer.timeline(), 0);
    keyWith("Alt_L", "i");
    EXPECT_EQ(viewer.editor().keyframes().size(), 1u);
    EXPECT_EQ(viewer.settings().light, kLightCapture);
    EXPECT_FALSE(viewer.settings().floor);
}

// G, the mouse, a click: no button is held.
TEST_F(KeysTest, AJointIsGrabbedByAKey) {
    Viewer& viewer = openWith("blender");
    screen_->key("g");
    settle();
    EXPECT_NE(viewer.message().find("no joint is selected"), std::string::npos);
    const glm::dvec2 wrist = at(joint::kLeftWrist);
    drag(wrist, wrist);
    ASSERT_EQ(viewer.selected(), joint::kLeftWrist);
    const Pose before = viewer.editor().pose();
    const size_t steps = viewer.editor().steps();

    const auto move = [&](glm::dvec2 to) {
        screen_->move(to.x, to.y);
        turn(3);
    };
    screen_->key("g");
    turn();
    move(wrist + glm::dvec2(-20, -60));
    EXPECT_GT(glm::distance(at(joint::kLeftWrist), wrist), 40);
    screen_->key("Escape");
    settle();
    EXPECT_EQ(viewer.editor().pose(), before);
    move(wrist);
    screen_->key("g");
    turn();
    move(wrist + glm::dvec2(-20, -60));
    screen_->click(3);
    settle();
    EXPECT_EQ(viewer.editor().pose(), before) << "the right button gives it up";
    EXPECT_EQ(viewer.editor().steps(), steps);

    move(wrist);
    screen_->key("g");
    turn();
    move(wrist + glm::dvec2(-20, -60));
    screen_->press(1);
    turn();
    screen_->release(1);
    settle();
    EXPECT_EQ(viewer.selected(), joint::kLeftWrist) << "the click deselects nothing";
    EXPECT_LT(glm::distance(at(joint::kLeftWrist), wrist + glm::dvec2(-20, -60)), 4);
    EXPECT_EQ(viewer.editor().steps(), steps + 1);
    const Pose grabbed = viewer.editor().pose();
    move(wrist);
    settle();
    EXPECT_EQ(viewer.editor().pose(), grabbed) << "it ended with the click";
}

TEST_F(KeysTest, AJointIsTurnedByAKeyAndNumbers) {
    Viewer& viewer = openWith("blender");
    viewer.settings().limits = false;
    const glm::dvec2 shoulder = at(joint::kLeftShoulder);
    drag(shoulder, shoulder);
    ASSERT_EQ(viewer.selected(), joint::kLeftShoulder);
    const Pose before = viewer.editor().pose();
    const auto turnedBy = [&] {
        const PosedSkeleton a = forwardKinematics(viewer.skeleton(), before), b = viewer.posed();
        const glm::dquat turn = glm::quat_cast(b.rotation[joint::kLeftShoulder] *
                                               glm::transpose(a.rotation[joint::kLeftShoulder]));
        return glm::degrees(glm::angle(turn));
    };
    for (const char* key : {"r", "z", "4", "5"}) {
        screen_->key(key);
        turn();
    }
    EXPECT_EQ(viewer.turnedText(), "45.0\u00b0");
    EXPECT_NEAR(turnedBy(), 45, 1e-3);
    screen_->key("minus");
    turn();
    EXPECT_EQ(viewer.turnedText(), "-45.0\u00b0");
    screen_->key("BackSpace");
    turn();
    EXPECT_EQ(viewer.turnedText(), "-4.0\u00b0");
    screen_->key("Return");
    settle();
    EXPECT_NEAR(turnedBy(), 4, 1e-3);
    EXPECT_EQ(viewer.turnedText(), "");
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose(), before);

    // Round the joint with the mouse: a quarter of the way round is a quarter of a turn.
    const glm::dvec2 centre = at(joint::kLeftShoulder);
    const auto arm = [&](double degrees) {
        const double a = glm::radians(degrees);
        screen_->move(centre.x + 90 * std::cos(a), centre.y + 90 * std::sin(a));
        turn(2);
    };
    arm(0);
    screen_->key("r");
    turn();
    for (int degrees = 0; degrees <= 90; degrees += 15) arm(degrees);
    EXPECT_NEAR(turnedBy(), 90, 2);
    screen_->key("Escape");
    settle();
    EXPECT_EQ(viewer.editor().pose(), before);
}

// As Blender's: the mouse looks around and keys go, without a button, until a click.
TEST_F(KeysTest, AWalkLeadsThroughTheScene) {
    Viewer& viewer = openWith("gltf");
    const OrbitCamera began = viewer.camera();
    const auto eye = [&] {
        const ViewTransform view = viewer.camera().view();
        return -(glm::transpose(view.rotation) * view.translation);
    };
    const auto hold = [&](const std::string& key, double seconds) {
        screen_->keyDown(key);
        const auto until =
            std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
        while (std::chrono::steady_clock::now() < until) turn(1);
        screen_->keyUp(key);
        turn();
    };
    const auto begin = [&] {
        screen_->keyDown("Shift_L");
        screen_->key("w");
        turn();
        screen_->keyUp("Shift_L");
        turn();
    };
    const auto click = [&](int button) {
        screen_->press(button);
        turn();
        screen_->release(button);
        settle();
    };
    screen_->move(200, 200);
    turn();
    begin();
    EXPECT_EQ(viewer.camera().yaw, began.yaw) << "to begin turns nothing";
    const glm::dvec3 from = eye();
    hold("w", .5);
    EXPECT_GT(eye().z, from.z + .05) << "ahead";
    EXPECT_LT(eye().z, from.z + 3);
    EXPECT_NEAR(eye().x, from.x, 1e-9);
    EXPECT_FALSE(viewer.settings().wireframe) << "W is for the walk";
    hold("d", .3);
    EXPECT_GT(eye().x, from.x + .02) << "to the right";
    hold("e", .3);
    EXPECT_LT(eye().y, from.y - .02) << "up";

    const glm::dvec3 stands = eye();
    screen_->move(kWidth - 40, kHeight / 2);  // the pointer is held in the middle
    turn(4);
    EXPECT_LT(viewer.camera().yaw, began.yaw - .01) << "looks to the right";
    EXPECT_LT(glm::distance(eye(), stands), 1e-9) << "and stands where it stood";
    const OrbitCamera there = viewer.camera();
    click(1);
    EXPECT_EQ(cameraText(viewer.camera()), cameraText(there)) << "a click stays";
    screen_->move(300, 240);
    settle();
    EXPECT_EQ(cameraText(viewer.camera()), cameraText(there)) << "and ends it";

    begin();
    hold("s", .3);
    EXPECT_NE(cameraText(viewer.camera()), cameraText(there));
    screen_->key("Escape");
    settle();
    EXPECT_EQ(cameraText(viewer.camera()), cameraText(there));
    begin();
    hold("a", .3);
    click(3);
    EXPECT_EQ(cameraText(viewer.camera()), cameraText(there)) << "so does the right button";
    begin();
    keyWith("Control_L", "c");
    EXPECT_EQ(viewer.message(), "pose copied");
    screen_->move(60, 60);
    settle();
    EXPECT_EQ(cameraText(viewer.camera()), cameraText(there)) << "what Ctrl begins ends it";
    screen_->key("w");
    settle();
    EXPECT_TRUE(viewer.settings().wireframe) << "W is again what it was";
}

TEST_F(KeysTest, HelpListsWhatIsInForceAndFitsTheWindow) {
    ViewerOptions options;
    options.keys = "blender";
    options.width = options.height = 600;
    Viewer& viewer = open(options);
    screen_->key("F1");
    settle();
    const auto lists = [&](const std::string& words) {
        return std::ranges::count(drawnItems(), words, &DrawnItem::label) > 0;
    };
    for (size_t i = 0; i < kActions; ++i) {
        const auto action = static_cast<Action>(i);
        if (viewer.keys().of(action).empty()) continue;
        EXPECT_TRUE(lists(viewer.keys().keysOf(action))) << infoOf(action).name;
        EXPECT_TRUE(lists(infoOf(action).does)) << infoOf(action).name;
    }
    for (const DrawnItem& item : drawnItems()) EXPECT_FALSE(item.cut) << item.label;
}

TEST_F(KeysTest, KeysAreChosenInTheHelpAndStay) {
    ViewerOptions options;
    options.state = *folder_ / "keys-state";
    options.width = 900, options.height = 740;
    Viewer& viewer = open(options);
    EXPECT_EQ(viewer.keys().name(), "gltf");
    screen_->key("h");
    settle();
    clickItem("keys");
    clickItem("Blender");
    EXPECT_EQ(viewer.keys().name(), "blender");
    EXPECT_EQ(readPreferences(options.state).keys, "blender");
    clickItem("own keys");
    const fs::path own = options.state / "keys.toml";
    ASSERT_TRUE(fs::exists(own)) << viewer.message();
    EXPECT_EQ(viewer.keys().of(Action::Grab), Bindings::preset("blender").of(Action::Grab));
    write(own, "wireframe = \"Q\"\n");
    clickItem("own keys");  // reads it again
    screen_->move(20, 20);
    screen_->key("q");
    settle();
    EXPECT_TRUE(viewer.settings().wireframe);

    viewer_.reset();
    Viewer& next = open(options);
    screen_->key("q");
    settle();
    EXPECT_TRUE(next.settings().wireframe);
    // A file that has become wrong is said, and the window opens.
    write(own, "wireframe = \"Qq\"\n");
    viewer_.reset();
    Viewer& last = open(options);
    EXPECT_EQ(last.keys().name(), "gltf");
    EXPECT_NE(last.message().find("keys.toml: line 1: wireframe"), std::string::npos)
        << last.message();
    viewer_.reset();
    options.keys = own.string();
    EXPECT_THROW(Viewer{options}, InputError) << "that was asked for now";
}

TEST_F(KeysTest, TwoFingersOnATouchpadOrbit) {
    ViewerOptions options;
    options.state = *folder_ / "touchpad-state";
    options.width = 900, options.height = 740;
    Viewer& viewer = open(options);
    screen_->key("h");
    settle();
    clickItem("touchpad");
    EXPECT_TRUE(readPreferences(options.state).touchpad);
    screen_->key("Escape");
    settle();
    screen_->move(40, 300);
    const OrbitCamera before = viewer.camera();
    screen_->click(4);
    screen_->click(6);
    settle();
    EXPECT_NE(viewer.camera().yaw, before.yaw);
    EXPECT_NE(viewer.camera().pitch, before.pitch);
    EXPECT_EQ(viewer.camera().distance, before.distance);
    screen_->keyDown("Shift_L");
    screen_->click(4);
    settle();
    screen_->keyUp("Shift_L");
    EXPECT_NE(viewer.camera().target, before.target);
    EXPECT_EQ(viewer.camera().distance, before.distance);
    screen_->keyDown("Control_L");
    screen_->click(4);
    settle();
    screen_->keyUp("Control_L");
    EXPECT_LT(viewer.camera().distance, before.distance);
    viewer_.reset();
    EXPECT_EQ(open(options).keys().of(Action::Orbit).front(), readChord("wheel"));
}

// On a German keyboard Z is where an American one has Y.
TEST_F(KeysTest, LettersAreWhereTheKeyboardHasThem) {
    ASSERT_EQ(system("setxkbmap de"), 0);
    open();
    Viewer& viewer = *viewer_;
    const glm::dvec2 wrist = at(joint::kLeftWrist);
    const Pose before = viewer.editor().pose();
    drag(wrist, wrist + glm::dvec2(-20, -40));
    const Pose after = viewer.editor().pose();
    ASSERT_NE(after, before);
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose(), before);
    keyWith("Control_L", "y");
    EXPECT_EQ(viewer.editor().pose(), after);
    viewer_.reset();
    ASSERT_EQ(system("setxkbmap us"), 0);
}

}  // namespace
}  // namespace doppel::test
