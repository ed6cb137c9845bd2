// The viewer in a real window, driven by mouse and keys as a user drives it.
#include "trainer/avatar/avatar_renderer.h"
#include "viewer/viewer.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <numbers>
#include <set>
#include <string_view>
#include <thread>

#include "engine/error.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/screen.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/networks.h"
#include "trainer/data/capture_writer.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;
using test::Screen;

constexpr int kWidth = 560, kHeight = 474;  // with the timeline; no panel unless a test opens it
constexpr int kTextureSize = 32;

// Colours that tell up from down and left from right in the atlas, and an untrained mesh network,
// which moves nothing but does all the work.
Avatar plainAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.betas = {0.5f, -1, 0.5f};
    avatar.preset = presetByName("ci");
    avatar.preset.mesh.hidden = 8;
    avatar.preset.mesh.blocks = avatar.preset.mesh.layers = 1;
    avatar.textureSize = kTextureSize;
    for (int y = 0; y < kTextureSize; ++y)
        for (int x = 0; x < kTextureSize; ++x)
            for (float c : {0.2f + 0.75f * float(x) / kTextureSize,
                            0.2f + 0.75f * float(y) / kTextureSize, ((x ^ y) & 4) ? 0.75f : 0.35f})
                avatar.texture.push_back(c);
    return avatar;
}

void addMeshNet(Avatar& avatar) {
    Parameters net;
    declareMeshNet(net, avatar, 1);
    for (const Parameters::Entry& entry : net.entries())
        avatar.meshNet[entry.name] = {
            entry.shape, std::vector<float>(static_cast<size_t>(elementCount(entry.shape)))};
}

Motion turningMotion(size_t frames) {
    Motion motion;
    motion.fps = 20;
    for (size_t f = 0; f < frames; ++f) {
        Theta theta{};
        auto root = uprightOrientation(0.3f * static_cast<float>(f));
        std::ranges::copy(root, theta.begin());
        theta[3 * 16 + 2] = -0.9f;
        theta[3 * 17 + 2] = 0.9f;
        motion.theta.push_back(theta);
        motion.trans.push_back({0, 0.1f, 3.2f});
    }
    return motion;
}

class ViewerTest : public testing::Test {
protected:
    static void SetUpTestSuite() {
        screen_ = new Screen(1000, 760);
        folder_ = new Folder;
        Avatar avatar = plainAvatar();
        addMeshNet(avatar);
        writeAvatar(*folder_ / "avatar", avatar);
    }
    static void TearDownTestSuite() {
        delete screen_;
        delete folder_;
    }

    // A turn that never ends would hold up all tests.
    void SetUp() override {
        signal(SIGALRM, [](int) {
            constexpr std::string_view kSentence =
                "a turn of the window hangs: this test has taken ten minutes\n";
            if (write(STDERR_FILENO, kSentence.data(), kSentence.size()) < 0) _exit(2);
            _exit(1);
        });
        alarm(600);
    }
    void TearDown() override { alarm(0); }

    // A viewer without its panel, showing the avatar from the front.
    Viewer& open(ViewerOptions options = {}) {
        if (options.avatar.empty()) options.avatar = *folder_ / "avatar";
        if (options.width == 1280) options.width = kWidth, options.height = kHeight;
        viewer_.emplace(options);
        viewer_->settings().panel = viewer_->settings().figures = false;
        screen_->move(9, 9);  // so that the window hears of the mouse wherever it was
        turn();
        screen_->move(3, 3);
        settle();
        viewer_->camera().yaw = viewer_->camera().pitch = 0;
        screen_->key("Home");
        settle();
        return *viewer_;
    }
    void turn(int times = 3) {
        for (int i = 0; i < times; ++i) ASSERT_TRUE(viewer_->frame());
    }
    // Until nothing changes any more.
    void settle() {
        turn(4);
        for (int i = 0; i < 2000 && !viewer_->settled(); ++i) viewer_->frame();
        ASSERT_TRUE(viewer_->settled());
    }
    void drag(glm::dvec2 from, glm::dvec2 to, int button = 1, int steps = 6) {
        screen_->move(from.x, from.y);
        turn();
        screen_->press(button);
        turn();
        for (int i = 1; i <= steps; ++i) {
            glm::dvec2 at = from + (to - from) * (double(i) / steps);
            screen_->move(at.x, at.y);
            turn(2);
        }
        screen_->release(button);
        settle();
    }
    void keyWith(const std::string& modifier, const std::string& key) {
        screen_->keyDown(modifier);
        screen_->key(key);
        screen_->keyUp(modifier);
        settle();
    }
    glm::dvec2 at(size_t joint) { return viewer_->jointOnScreen(joint); }
    // Metres that a distance on the screen is at the joint's depth.
    double metres(double pixels, size_t joint) {
        Camera camera = viewer_->camera().camera(kWidth, kHeight - Viewer::kTimelineHeight);
        return pixels * viewer_->jointOnScreen(joint).z / camera.fx;
    }
    // Until the condition holds; two minutes are more than any machine takes.
    static void await(const std::string& what, const std::function<bool()>& holds) {
        auto limit = std::chrono::steady_clock::now() + std::chrono::minutes(2);
        while (!holds()) {
            ASSERT_LT(std::chrono::steady_clock::now(), limit) << "waited in vain for " << what;
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
    }
    // As a user who looks at something: nothing has changed for so long that the window draws
    // nothing.
    void rest() {
        settle();
        turn(1);  // it waits a quarter of a second for an event
    }
    // The panes, once the screen shows what the window has drawn.
    Image picture() {
        const Pane& last = viewer_->panes().back();
        const Canvas& drawn = viewer_->window().drawn();
        Image image(last.x + last.width, last.height, 3);
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x)
                for (int c = 0; c < 3; ++c)
                    image.pixel(x, y)[drawn.blueFirst ? 2 - c : c] =
                        static_cast<uint8_t>(drawn.row(y)[static_cast<size_t>(x)] >> 8 * c);
        await("the screen to show what the window has drawn",
              [&] { return screen_->grab(0, 0, image.width, image.height).data == image.data; });
        return image;
    }

    static inline Screen* screen_ = nullptr;
    static inline Folder* folder_ = nullptr;
    std::optional<Viewer> viewer_;
};

// How many pixels differ visibly, as a share of all.
double difference(const Image& a, const Image& b) {
    if (a.width != b.width || a.height != b.height) return 1;
    int different = 0;
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x)
            for (int c = 0, seen = 0; c < 3 && !seen; ++c)
                if (std::abs(a.pixel(x, y)[c] - b.pixel(x, y)[c]) > 24) ++different, seen = 1;
    return double(different) / (a.width * a.height);
}

// Against tests/screens/NAME.png, a quarter of the size; DOPPEL_WRITE_SCREENS=1 writes it anew.
void expectScreen(const Image& picture, const std::string& name) {
    Image small = resize(picture, picture.width / 4, picture.height / 4);
    fs::path path = fs::path(DOPPEL_SOURCE_DIR) / "tests" / "screens" / (name + ".png");
    const char* writes = getenv("DOPPEL_WRITE_SCREENS");
    if (writes && std::string_view(writes) == "1") {
        fs::create_directories(path.parent_path());
        writeImage(path, small);
    }
    ASSERT_TRUE(fs::exists(path)) << path;
    EXPECT_LT(difference(small, readImage(path)), 0.01) << name;
}

TEST_F(ViewerTest, DraggingTheLeftWristMovesTheHandToTheCursor) {
    Viewer& viewer = open();
    Pose before = viewer.editor().pose();
    glm::dvec2 from = at(joint::kLeftWrist), to = from + glm::dvec2(-30, -90);
    double depth = viewer.jointOnScreen(joint::kLeftWrist).z;
    drag(from, to);
    EXPECT_LT(metres(glm::distance(at(joint::kLeftWrist), to), joint::kLeftWrist), 0.02);
    EXPECT_NEAR(viewer.jointOnScreen(joint::kLeftWrist).z, depth, 0.02);
    EXPECT_EQ(viewer.selected(), size_t{joint::kLeftWrist});
    EXPECT_NE(viewer.editor().pose(), before);
    // The other side stays to the last bit.
    for (size_t j : {joint::kRightShoulder, joint::kRightElbow, joint::kLeftKnee})
        EXPECT_EQ(viewer.editor().pose().rotation[j], before.rotation[j]);

    Pose after = viewer.editor().pose();
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose(), before);
    keyWith("Control_L", "y");
    EXPECT_EQ(viewer.editor().pose(), after);
    EXPECT_EQ(viewer.editor().steps(), 1u);
    expectScreen(picture(), "wrist");
}

TEST_F(ViewerTest, EscapeGivesADragUp) {
    Viewer& viewer = open();
    Pose before = viewer.editor().pose();
    glm::dvec2 from = at(joint::kRightAnkle);
    screen_->move(from.x, from.y);
    turn();
    screen_->press(1);
    turn();
    screen_->move(from.x + 40, from.y - 60);
    turn(4);
    EXPECT_NE(viewer.editor().pose(), before);
    screen_->key("Escape");
    turn(4);
    EXPECT_EQ(viewer.editor().pose(), before);
    screen_->release(1);
    settle();
    EXPECT_EQ(viewer.editor().pose(), before);
    EXPECT_FALSE(viewer.editor().canUndo());
}

TEST_F(ViewerTest, PinnedFeetStayWhereTheyAre) {
    Viewer& viewer = open();
    for (size_t foot : {joint::kLeftAnkle, joint::kRightAnkle}) {
        glm::dvec2 place = at(foot);
        screen_->move(place.x, place.y);
        turn();
        screen_->key("p");
        settle();
    }
    PosedSkeleton before = viewer.posed();
    glm::dvec2 from = at(joint::kPelvis);
    drag(from, from + glm::dvec2(0, 25));
    PosedSkeleton after = viewer.posed();
    EXPECT_GT(glm::distance(after.position[joint::kPelvis], before.position[joint::kPelvis]), 0.05);
    for (size_t foot : {joint::kLeftAnkle, joint::kRightAnkle})
        EXPECT_LT(glm::distance(after.position[foot], before.position[foot]), 0.01);
}

TEST_F(ViewerTest, ARingTurnsTheSelectedJoint) {
    Viewer& viewer = open();
    glm::dvec2 elbow = at(joint::kLeftElbow);
    screen_->move(elbow.x, elbow.y);
    turn();
    screen_->click(1);
    settle();
    ASSERT_EQ(viewer.selected(), size_t{joint::kLeftElbow});
    Pose before = viewer.editor().pose();
    // Somewhere on a circle of the gizmo's size a ring is met, whichever way the rings lie.
    bool turned = false;
    for (double angle = 0; angle < 6.2 && !turned; angle += 0.1) {
        glm::dvec2 on = elbow + 74.0 * glm::dvec2(std::cos(angle), std::sin(angle));
        if (on.x < 4 || on.y < 4 || on.x > kWidth - 4) continue;
        OrbitCamera camera = viewer.camera();
        drag(on, on + 25.0 * glm::dvec2(-std::sin(angle), std::cos(angle)));
        turned = viewer.editor().pose() != before;
        viewer.camera() = camera;
        settle();
    }
    ASSERT_TRUE(turned);
    Pose after = viewer.editor().pose();
    for (size_t j = 0; j < joint::kCount; ++j)
        EXPECT_EQ(after.rotation[j] == before.rotation[j], j != joint::kLeftElbow) << jointName(j);
    screen_->key("r");
    settle();
    EXPECT_EQ(viewer.editor().pose(), before);
}

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

TEST_F(ViewerTest, EverySurfaceLooksDifferent) {
    Viewer& viewer = open();
    std::vector<Image> seen;
    const char* names[] = {"texture", "clay",  "normals", "visibility",
                           "checker", "parts", "clamps"};
    for (uint32_t paint = kPaintTexture; paint <= kPaintClamps; ++paint) {
        viewer.settings().paint = paint;
        settle();
        Image now = picture();
        for (const Image& other : seen) EXPECT_GT(difference(now, other), 0.02) << names[paint];
        expectScreen(now, names[paint]);
        seen.push_back(now);
    }
    viewer.settings().paint = kPaintTexture;
    viewer.settings().lit = true;
    settle();
    expectScreen(picture(), "lit");
    EXPECT_GT(difference(picture(), seen[0]), 0.02);
    viewer.settings().lit = false;
    viewer.settings().wireframe = true;
    viewer.settings().atlas = true;
    settle();
    expectScreen(picture(), "wireframe");
    viewer.settings().wireframe = viewer.settings().atlas = false;
    viewer.settings().split = Split::Meshes;
    settle();
    ASSERT_EQ(viewer.panes().size(), 2u);
    expectScreen(picture(), "split");
}

TEST_F(ViewerTest, ThePanelOpensAndDoesNotOrbit) {
    Viewer& viewer = open();
    screen_->key("n");
    settle();
    ASSERT_TRUE(viewer.settings().panel);
    const Pane& pane = viewer.panes().back();
    EXPECT_EQ(pane.width, kWidth - Viewer::kPanelWidth);
    double yaw = viewer.camera().yaw;
    drag({pane.width + 60.0, 420}, {pane.width + 200.0, 420});
    EXPECT_EQ(viewer.camera().yaw, yaw);
    EXPECT_FALSE(viewer.settings().wireframe);
    screen_->move(pane.width + 18.0, 132);  // its box
    turn();
    screen_->click(1);
    settle();
    EXPECT_TRUE(viewer.settings().wireframe);
}

// While the mouse rests nothing is drawn; what is open, held or typed into stays so.
TEST_F(ViewerTest, RemembersItsPanelWhileTheMouseRests) {
    Viewer& viewer = open();
    screen_->key("n");
    settle();
    ASSERT_TRUE(viewer.settings().panel);
    int left = viewer.panes().back().width;
    auto restAt = [&](double x, double y) {
        screen_->move(x, y);
        rest();
    };
    auto clickAt = [&](double x, double y) {
        restAt(x, y);
        screen_->press(1);
        rest();
        screen_->release(1);
        rest();
    };
    clickAt(left + 18, 132);
    EXPECT_TRUE(viewer.settings().wireframe) << "a box";
    clickAt(left + 18, 132);
    EXPECT_FALSE(viewer.settings().wireframe) << "a box";

    clickAt(left + 80, 69);  // the list of surfaces
    clickAt(left + 80, 113);
    EXPECT_EQ(viewer.settings().paint, kPaintNormals) << "an open list";

    clickAt(left + 155, 17);  // the tab of files
    clickAt(left + 80, 88);   // the path
    for (const char* key : {"w", "n", "h", "5"}) {
        screen_->key(key);
        rest();
    }
    EXPECT_FALSE(viewer.settings().wireframe) << "the path's field";
    EXPECT_TRUE(viewer.settings().panel) << "the path's field";
    EXPECT_FALSE(viewer.settings().help) << "the path's field";
    EXPECT_FALSE(viewer.camera().orthographic) << "the path's field";
    clickAt(left + 24, 111);  // opens what was typed
    EXPECT_NE(viewer.message().find("wnh5"), std::string::npos) << viewer.message();

    restAt(100, kHeight - 34);  // the timeline's slider
    screen_->press(1);
    rest();
    double began = viewer.timeline();
    EXPECT_GT(began, 5);
    restAt(300, kHeight - 34);
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
    EXPECT_GT(difference(screen_->grab(0, 0, 800, 500), Image(800, 500, 3, 0)), 0.5);
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

TEST_F(ViewerTest, PlaysMotions) {
    Motion motion = turningMotion(9);
    fs::path poses = *folder_ / "poses.npz";
    Npz arrays = posesArrays(motion.theta, motion.trans, {});
    arrays.set("fps", Array::f32({}, std::array{20.0f}));
    writeNpz(poses, arrays, false);
    ViewerOptions options;
    options.motion = poses;
    Viewer& viewer = open(options);
    EXPECT_EQ(viewer.frameCount(), 9);
    Pose first = viewer.editor().pose();
    screen_->key("Right");
    settle();
    EXPECT_EQ(viewer.timeline(), 1);
    EXPECT_NE(viewer.editor().pose(), first);
    screen_->key("space");
    double sum = 0, last = viewer.timeline();
    await("the motion to play", [&] {
        viewer.frame();
        sum += std::abs(viewer.timeline() - last);
        last = viewer.timeline();
        return sum > 1;
    });
    screen_->key("space");
    settle();
    screen_->key("Left");
    settle();
    EXPECT_EQ(viewer.timeline(), std::floor(viewer.timeline()));
    EXPECT_EQ(messageOf<InputError>([&] { viewer.loadMotion(*folder_ / "none.npz"); }).empty(),
              false);
    EXPECT_EQ(viewer.frameCount(), 9);  // the old one is still there
}

TEST_F(ViewerTest, LooksThroughTheCapturesCamera) {
    Motion motion = turningMotion(2);
    fs::path folder = *folder_ / "capture";
    {
        CaptureWriter writer(folder);
        Capture capture;
        capture.name = "captured";
        for (size_t f = 0; f < motion.size(); ++f) {
            std::string name = fmt::format("{}", f);
            Image frame(80, 60, 3);
            for (size_t i = 0; i < frame.data.size(); ++i)
                frame.data[i] = i % 3 == f ? 200 : 40;  // red, then green
            writer.addImage(name, 80, 60, frame.data);
            capture.frames.push_back({name, {}, {}, {75, 75, 40, 30, 80, 60}});
            capture.theta.push_back(motion.theta[f]);
            capture.trans.push_back(motion.trans[f]);
        }
        writer.commit(capture);
    }
    ViewerOptions options;
    options.motion = folder;
    Viewer& viewer = open(options);
    screen_->key("0");
    settle();
    ASSERT_TRUE(viewer.settings().captureCamera);
    // The frame is as large as the pane allows, 533 by 400 in the middle of 560 by 400.
    const Pane& pane = viewer.panes().back();
    double scale = pane.height / 60.0, left = (pane.width - 80 * scale) / 2;
    PosedSkeleton body = viewer.posed();
    glm::dvec3 head = body.position[joint::kHead];
    EXPECT_NEAR(at(joint::kHead).x, left + scale * (75 * head.x / head.z + 40), 1e-6);
    EXPECT_NEAR(at(joint::kHead).y, scale * (75 * head.y / head.z + 30), 1e-6);
    for (int f : {0, 1}) {
        Image now = picture();
        const uint8_t* inside = now.pixel(static_cast<int>(left) + 20, 30);
        EXPECT_NEAR(inside[f], 200, 2) << f;
        EXPECT_NEAR(inside[1 - f], 40, 2) << f;
        EXPECT_LT(now.pixel(4, 30)[f], 100) << f;  // beside the frame
        screen_->key("Right");
        settle();
    }
    // Orbiting begins where the capture's camera stood.
    glm::dvec2 before = at(joint::kHead);
    drag({30, 300}, {30, 300}, 2, 1);
    EXPECT_FALSE(viewer.settings().captureCamera);
    EXPECT_LT(glm::distance(at(joint::kHead), before), 2);
}

TEST_F(ViewerTest, KeyframesAreSavedAndReadAgain) {
    Viewer& viewer = open();
    screen_->key("k");
    settle();
    glm::dvec2 from = at(joint::kRightWrist);
    drag(from, from + glm::dvec2(20, -80));
    viewer.editor().setKeyframe(10);
    EXPECT_EQ(viewer.frameCount(), 11);
    fs::path poses = *folder_ / "keys.npz";
    viewer.savePoses(poses);
    Motion motion = readMotion(poses);
    ASSERT_EQ(motion.size(), 2u);
    for (size_t k = 0; k < 72; ++k)
        EXPECT_NEAR(motion.theta[1][k], thetaOf(viewer.editor().poseAt(10))[k], 1e-6);
    screen_->key("Right");
    settle();
    EXPECT_EQ(viewer.timeline(), 1);
    EXPECT_EQ(viewer.editor().pose(), viewer.editor().poseAt(1));
}

TEST_F(ViewerTest, FilmsWhatIsShown) {
    fs::path poses = *folder_ / "film.npz";
    Motion motion = turningMotion(5);
    writeNpz(poses, posesArrays(motion.theta, motion.trans, {}), false);
    ViewerOptions options;
    options.motion = poses;
    Viewer& viewer = open(options);
    fs::path film = *folder_ / "film.mp4", frames = *folder_ / "frames";
    for (const fs::path& out : {film, frames}) {
        viewer.startFilm(out, 200);
        for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
        ASSERT_FALSE(viewer.working());
    }
    VideoReader reader(film);
    EXPECT_EQ(reader.frameCount(), 5);
    EXPECT_EQ(reader.width(), 200);
    Image first, last;
    reader.next(first);
    for (int i = 1; i < 5; ++i) reader.next(last);
    EXPECT_GT(difference(first, last), 0.02);
    EXPECT_LT(difference(resize(readImage(frames / "0004.png"), last.width, last.height), last),
              0.1);
    // What is given up leaves nothing.
    viewer.startFilm(*folder_ / "half.mp4", 0);
    turn(2);
    screen_->key("Escape");
    settle();
    EXPECT_FALSE(fs::exists(*folder_ / "half.mp4"));
    EXPECT_EQ(viewer.timeline(), 0);
    EXPECT_EQ(messageOf<InputError>([&] { viewer.startFilm(*folder_ / "avatar", 0); }).empty(),
              false);
}

TEST_F(ViewerTest, ExportsWhatIsShown) {
    Viewer& viewer = open();
    glm::dvec2 from = at(joint::kLeftWrist);
    drag(from, from + glm::dvec2(0, -60));
    fs::path out = *folder_ / "pose.glb";
    viewer.startExport(out);
    for (int i = 0; i < 3000 && viewer.working(); ++i) viewer.frame();
    ASSERT_TRUE(fs::exists(out)) << viewer.message();
    EXPECT_GT(fs::file_size(out), 100'000u);
    EXPECT_NE(messageOf<InputError>([&] { viewer.startExport("a.obj"); }).find(".glb"),
              std::string::npos);
}

TEST_F(ViewerTest, PaintsTheViewInTheBackground) {
    fs::path folder = *folder_ / "painted";
    {
        Device device;
        Avatar avatar = plainAvatar();
        avatar.preset.texture.constantInput = false;
        avatar.preset.texture.textureSize = kTextureSize;
        avatar.preset.texture.width = 2;
        avatar.preset.texture.depth = 3;
        avatar.textureNet = TextureNet(device, avatar, 3).weights();
        writeAvatar(folder, avatar);
    }
    ViewerOptions options;
    options.avatar = folder;
    Viewer& viewer = open(options);
    EXPECT_GT(viewer.times().paint, 0);
    Image painted = picture();  // an untrained network's grey, not the coloured texture of the file
    viewer.settings().texture = TextureKind::Baked;
    settle();
    EXPECT_GT(difference(painted, picture()), 0.02);
}

TEST_F(ViewerTest, FollowsATrainingAndOutlivesItsFolder) {
    fs::path folder = *folder_ / "training";
    Avatar avatar = plainAvatar();
    writeAvatar(folder, avatar);
    ViewerOptions options;
    options.avatar = folder;
    Viewer& viewer = open(options);
    Image before = picture();
    for (float& value : avatar.texture) value = 1 - value;
    writeAvatar(liveFolder(folder), avatar);
    fs::last_write_time(liveFolder(folder) / "avatar.toml",
                        fs::last_write_time(folder / "avatar.toml") + std::chrono::seconds(2));
    for (int i = 0; i < 100 && viewer.message().empty(); ++i) viewer.frame();
    settle();
    EXPECT_EQ(viewer.message(), "the training's present state");
    EXPECT_GT(difference(before, picture()), 0.02);

    fs::remove_all(folder);
    turn(5);
    glm::dvec2 from = at(joint::kLeftWrist);
    drag(from, from + glm::dvec2(0, -60));
    EXPECT_TRUE(viewer.editor().canUndo());
    viewer.startExport(*folder_ / "orphan.glb");
    for (int i = 0; i < 3000 && viewer.working(); ++i) viewer.frame();
    EXPECT_TRUE(fs::exists(*folder_ / "orphan.glb")) << viewer.message();
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
    screen_->key("n");
    awaitSecond("to open its panel", [&] { return difference(panel(), shown) < 0.05; });
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

// What a move of the mouse asks for is on the picture of the turn that takes it.
TEST_F(ViewerTest, EachMoveIsOnTheNextPicture) {
    Viewer& viewer = open();
    for (bool orbits : {false, true}) {
        glm::dvec2 from = orbits ? glm::dvec2(40, 300) : at(joint::kLeftWrist);
        screen_->move(from.x, from.y);
        turn();
        screen_->press(orbits ? 2 : 1);
        turn();
        for (int i = 1; i <= 40; ++i) {
            uint64_t pictures = viewer.pictureCount();
            double yaw = viewer.camera().yaw;
            glm::dvec2 to = from + glm::dvec2(i % 2 ? 20 : -20, -1.5 * i);
            screen_->move(to.x, to.y);
            await("the move to reach the window", [&] {
                viewer.frame();
                return viewer.window().touched();
            });
            EXPECT_EQ(viewer.pictureCount(), pictures + 1) << i;
            if (orbits)
                EXPECT_NE(viewer.camera().yaw, yaw) << i;
            else
                EXPECT_LT(glm::distance(at(joint::kLeftWrist), to), 4) << i;
        }
        screen_->release(orbits ? 2 : 1);
        settle();
    }
}

// The viewer's own shading of the shared visibility buffer, against the pictures of `doppel
// render`.
TEST_F(ViewerTest, DrawsWhatRenderDraws) {
    Device device;
    Avatar avatar = readAvatar(*folder_ / "avatar");
    Motion motion = turningMotion(3);
    Camera camera{300, 300, 128, 120, 256, 240};
    Scene scene(device, avatar);
    AvatarRenderer renderer(device, avatar);
    std::vector<uint32_t> background(256 * 240, 0xff4080c0u);
    std::vector<float> backdrop;
    for (size_t i = 0; i < background.size(); ++i)
        for (int byte : {0xc0, 0x80, 0x40}) backdrop.push_back(static_cast<float>(byte) / 255.0f);
    for (size_t f = 0; f < motion.size(); ++f) {
        scene.setPose(motion.theta[f], motion.trans[f], avatar.betas);
        std::vector<uint32_t> drawn = scene.draw(MeshKind::Refined, camera, {}, {}, background, 2);
        Drawing drawing = renderer.draw(motion.theta[f], motion.trans[f], camera, 2);
        std::vector<float> rendered = composite(drawing.rgb, drawing.mask, backdrop);
        int worst = 0, covered = 0;
        for (size_t i = 0; i < drawn.size(); ++i) {
            covered += drawing.mask[i] > 0;
            for (size_t c = 0; c < 3; ++c)
                worst = std::max(
                    worst, std::abs(static_cast<int>(drawn[i] >> 8 * c & 0xff) -
                                    static_cast<int>(std::lround(255 * rendered[3 * i + c]))));
        }
        EXPECT_GT(covered, 4000);
        EXPECT_LE(worst, 3) << f;
    }
}

// Shifts that leave no stretch of the pixel out, and add up to nothing after every second one.
TEST_F(ViewerTest, RefinementsCoverThePixelEvenly) {
    std::set<int> columns, rows, squares;
    glm::dvec2 sum(0);
    for (int k = 0; k < kRefinements; ++k) {
        glm::dvec2 shift = refinementShift(k), unit = shift + 0.5;
        columns.insert(static_cast<int>(16 * unit.x));
        rows.insert(static_cast<int>(16 * unit.y));
        squares.insert(static_cast<int>(4 * unit.x) + 4 * static_cast<int>(4 * unit.y));
        sum += shift;
        if (k == 0) {
            EXPECT_LT(glm::length(shift), 0.05);
        }
        if (k % 2 == 1) {
            EXPECT_EQ(glm::length(sum), 0) << k;
        }
    }
    for (const std::set<int>& seen : {columns, rows, squares}) {
        EXPECT_EQ(seen.size(), 16u);
        EXPECT_EQ(*seen.begin(), 0);
        EXPECT_EQ(*seen.rbegin(), 15);
    }
}

TEST_F(ViewerTest, WhatIsAddedUpIsTheMeanOfTheSinglePictures) {
    Device device;
    Avatar avatar = readAvatar(*folder_ / "avatar");
    std::vector<float> dark = avatar.texture;
    for (float& value : dark) value *= 0.4f;
    Motion motion = turningMotion(2);
    const Camera camera{300, 300, 128, 120, 256, 240};
    std::vector<uint32_t> background(256 * 240);
    for (size_t i = 0; i < background.size(); ++i)
        background[i] = 0xff000000u | static_cast<uint32_t>(i * 2654435761u >> 8 & 0xffffff);
    Scene scene(device, avatar), single(device, avatar);
    auto expectMean = [&](const std::vector<std::array<int, 3>>& sums, int count,
                          const std::vector<uint32_t>& mean) {
        double worst = 0;
        for (size_t i = 0; i < mean.size(); ++i)
            for (size_t c = 0; c < 3; ++c)
                worst = std::max(worst, std::abs(static_cast<double>(sums[i][c]) / count -
                                                 (mean[i] >> 8 * c & 0xff)));
        EXPECT_LE(worst, 0.501) << count;
    };
    ShadeOptions options;
    options.lit = options.wireframe = options.blueFirst = true;
    // Side by side, as two panes are, with nothing between them but their places; then anew in
    // another pose.
    for (size_t pose : {0, 1}) {
        scene.setPose(motion.theta[pose], motion.trans[pose], avatar.betas);
        single.setPose(motion.theta[pose], motion.trans[pose], avatar.betas);
        std::vector<std::array<int, 3>> sums[2];
        std::vector<uint32_t> means[2];
        for (int k = 0; k < kRefinements; ++k)
            for (int place : {0, 1}) {
                for (Scene* with : {&scene, &single})
                    with->setTexture(place ? dark : avatar.texture);
                Camera shifted = camera;
                shifted.cx += refinementShift(k).x, shifted.cy += refinementShift(k).y;
                std::vector<uint32_t> one =
                    single.draw(MeshKind::Refined, shifted, {}, options, background);
                if (k == 0) sums[place].resize(one.size());
                for (size_t i = 0; i < one.size(); ++i)
                    for (size_t c = 0; c < 3; ++c)
                        sums[place][i][c] += static_cast<int>(one[i] >> 8 * c & 0xff);
                means[place] = scene.refine(MeshKind::Refined, camera, {}, options, background,
                                            place, k, std::move(means[place]));
                expectMean(sums[place], k + 1, means[place]);
                if (k == 0) {
                    EXPECT_EQ(means[place], one);
                }
            }
        EXPECT_NE(means[0], means[1]);
    }
}

// The picture becomes finer turn by turn once all is at rest; then the device has nothing to do.
TEST_F(ViewerTest, BecomesFinerAtRestAndThenStops) {
    Viewer& viewer = open();
    viewer.settings().joints = false;
    auto turnUntilRefined = [&](int count) {
        for (int i = 0; i < 2000 && viewer.refinements() != count; ++i) viewer.frame();
        ASSERT_EQ(viewer.refinements(), count);
    };
    auto expectAnew = [&](const std::string& what) {
        uint64_t pictures = viewer.pictureCount();
        viewer.frame();
        EXPECT_EQ(viewer.refinements(), 0) << what;
        EXPECT_EQ(viewer.pictureCount(), pictures + 1) << what;
        Image moving = picture();
        turnUntilRefined(1);
        EXPECT_LT(difference(moving, picture()), 0.003) << what;
        turnUntilRefined(2);
        turnUntilRefined(3);  // and is disturbed there
    };
    settle();
    EXPECT_EQ(viewer.refinements(), kRefinements);
    uint64_t submissions = viewer.device().submissions(), pictures = viewer.pictureCount();
    rest();
    screen_->move(20, 20);  // over nothing
    rest();
    EXPECT_EQ(viewer.device().submissions(), submissions);
    EXPECT_EQ(viewer.pictureCount(), pictures);
    EXPECT_EQ(viewer.refinements(), kRefinements);

    viewer.camera().yaw = 0.3;
    expectAnew("the camera");
    Pose pose = viewer.editor().pose();
    pose.rotation[joint::kHead] = {0, 0.25, 0};
    viewer.editor().setPose(pose);
    expectAnew("the pose");
    viewer.settings().lit = true;
    expectAnew("the light");
    viewer.settings().split = Split::Meshes;
    expectAnew("two panes");
    settle();
    EXPECT_EQ(viewer.refinements(), kRefinements);
}

// The window compiles no shader, so the widest vectors do not harm it (viewer/swapchain.h).
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

// While a limb moves, the rest of the picture stays as it was drawn.
TEST_F(ViewerTest, DrawsAgainOnlyWhereSomethingMoved) {
    Device device;
    Avatar avatar = readAvatar(*folder_ / "avatar");
    Camera camera{600, 600, 256, 240, 512, 480};
    std::vector<uint32_t> background(512 * 480, 0xff4080c0u), other(512 * 480, 0xff102030u);
    Motion motion = turningMotion(1);
    Theta bent = motion.theta[0];
    bent[3 * 18 + 1] += 0.6f;
    for (bool lit : {false, true}) {
        Scene scene(device, avatar), fresh(device, avatar);
        ShadeOptions options;
        options.paint = lit ? kPaintClay : kPaintTexture;
        options.lit = lit;
        auto draw = [&](Scene& with, const Theta& theta, std::vector<uint32_t> reused,
                        const std::vector<uint32_t>& behind) {
            with.setPose(theta, motion.trans[0], avatar.betas);
            return with.draw(MeshKind::Refined, camera, {}, options, behind, 1, std::move(reused));
        };
        auto differences = [](std::span<const uint32_t> a, std::span<const uint32_t> b) {
            int count = 0;
            for (size_t i = 0; i < a.size(); ++i) count += a[i] != b[i];
            return count;
        };
        std::vector<uint32_t> picture = draw(scene, motion.theta[0], {}, background);
        std::vector<uint32_t> whole = draw(fresh, bent, {}, background);
        EXPECT_GT(differences(picture, whole), 500);
        picture[0] = 0xff0000ffu;  // far from the arm
        picture = draw(scene, bent, std::move(picture), background);
        EXPECT_EQ(picture[0], 0xff0000ffu) << "this corner was drawn again";
        picture[0] = whole[0];
        // Elsewhere on the picture positions are rounded in another way.
        EXPECT_LE(differences(picture, whole), 20);
        // Another background, or view, is drawn as a whole.
        picture = draw(scene, bent, std::move(picture), other);
        EXPECT_EQ(differences(picture, draw(fresh, bent, {}, other)), 0);
        picture[0] = 0xff0000ffu;
        camera.cx += 3;
        picture = draw(scene, bent, std::move(picture), other);
        EXPECT_EQ(differences(picture, draw(fresh, bent, {}, other)), 0);
        camera.cx -= 3;
    }
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
}  // namespace doppel
