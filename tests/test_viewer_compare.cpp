// Two avatars, meshes or textures in one picture.
#include "tests/viewer_test.h"
#include "trainer/avatar/rendering.h"

namespace doppel::test {
namespace {

// Blue all over.
void writeBlue(const fs::path& folder) {
    Avatar avatar = plainAvatar();
    for (size_t i = 0; i < avatar.texture.size(); ++i) avatar.texture[i] = i % 3 == 2 ? 1.f : 0.f;
    avatar.betas[0] += 2;
    writeAvatar(folder, avatar);
}

// Of the pixels [from,to) of each row those that are as blue as the other avatar.
double bluePart(const Image& image, int from, int to) {
    int blue = 0, all = 0;
    for (int y = 0; y < image.height; ++y)
        for (int x = from; x < to; ++x, ++all) {
            const uint8_t* rgb = image.pixel(x, y);
            blue += rgb[2] > 200 && rgb[0] < 60;
        }
    return static_cast<double>(blue) / all;
}

TEST_F(ViewerTest, AnotherAvatarIsTheOtherPartOfThePicture) {
    writeBlue(*folder_ / "blue");
    Viewer& viewer = open();
    const Image alone = picture();
    viewer.compareWith(*folder_ / "blue");
    settle();
    ASSERT_EQ(viewer.panes().size(), 2u);
    const int line = viewer.panes()[1].x, width = alone.width;
    awaitSilence();
    EXPECT_NEAR(line, width / 2, 1);
    const Image both = picture();
    EXPECT_EQ(bluePart(both, 0, line), 0);
    EXPECT_GT(bluePart(both, line, width), .02);
    // To the left of the line the picture is what it was.
    int differs = 0;
    for (int y = 0; y < alone.height - 120; ++y)  // but for the label
        for (int x = 0; x < line - 12; ++x)
            differs += std::abs(alone.pixel(x, y)[0] - both.pixel(x, y)[0]) > 2;
    EXPECT_EQ(differs, 0);

    // The line goes with the mouse, and back; the camera stays.
    const double yaw = viewer.camera().yaw;
    drag({double(line), 200}, {double(width - 30), 200});
    EXPECT_NEAR(viewer.panes()[1].x, width - 30, 3);
    EXPECT_LT(bluePart(picture(), 0, width), .002);
    drag({double(width - 30), 200}, {30, 200});
    EXPECT_NEAR(viewer.panes()[1].x, 30, 3);
    EXPECT_GT(bluePart(picture(), 30, width), .03);
    EXPECT_EQ(viewer.camera().yaw, yaw);
    drag({30, 200}, {5000, 200});
    EXPECT_LT(viewer.panes()[1].x, width) << "the line stays in the picture";
    viewer.settings().divider = .5f;

    // Poses are shared.
    const Image before = picture();
    Pose pose = viewer.editor().pose();
    pose.rotation[joint::kRightShoulder] = {0, 0, -1.2};
    pose.rotation[joint::kLeftShoulder] = {0, 0, 1.2};
    viewer.editor().setPose(pose);
    settle();
    EXPECT_GT(difference(picture(), before), .01);
    EXPECT_NE(bluePart(picture(), line, width), bluePart(before, line, width));

    // Side by side; then nothing.
    viewer.settings().divided = false;
    settle();
    EXPECT_EQ(viewer.panes()[1].viewWidth, viewer.panes()[1].width);
    EXPECT_GT(bluePart(picture(), width / 2, width), .02);
    screen_->key("b");
    settle();
    EXPECT_EQ(viewer.settings().split, Split::Together);
    EXPECT_EQ(viewer.panes().size(), 1u);
    screen_->key("b");
    settle();
    EXPECT_EQ(viewer.settings().split, Split::None);
    EXPECT_EQ(bluePart(picture(), 0, width), 0);
    for (size_t panes : {2u, 2u, 2u, 1u}) {
        screen_->key("b");
        settle();
        EXPECT_EQ(viewer.panes().size(), panes);
    }
}

// A motion of more than one body: who moved is beside the avatar that moves so.
TEST_F(ViewerTest, WhatAMotionComesFromIsBesideTheAvatar) {
    Viewer& viewer = open();
    for (int press = 0; press < 2; ++press) {
        screen_->key("b");
        settle();
    }
    EXPECT_EQ(viewer.settings().split, Split::Textures);
    screen_->key("b");
    settle();
    EXPECT_EQ(viewer.settings().split, Split::None) << "without a motion there is no source";

    Motion motion = turningMotion(4);
    const fs::path poses = *folder_ / "source.npz";
    writeNpz(poses, posesArrays(motion.theta, motion.trans, {}), false);
    viewer.loadMotion(poses);
    viewer.settings().split = Split::Source;
    viewer.settings().divided = viewer.settings().joints = false;
    settle();
    ASSERT_EQ(viewer.panes().size(), 2u);
    const int line = viewer.panes()[1].x;
    const auto half = [&](const Image& image, int from) {
        Image part(line - 8, image.height - 120, 3);
        for (int y = 0; y < part.height; ++y)
            for (int x = 0; x < part.width; ++x)
                for (int c = 0; c < 3; ++c) part.pixel(x, y)[c] = image.pixel(from + x, y + 60)[c];
        return part;
    };
    const Image body = picture();
    EXPECT_GT(shareOfAvatar(half(body, 0)), .03) << "a body of clay";
    EXPECT_GT(difference(half(body, 0), half(body, line)), .03);
    // An edit is the avatar's alone; a frame on, both go on.
    Pose pose = viewer.editor().pose();
    pose.rotation[joint::kLeftShoulder] = {0, 0, 1};
    viewer.editor().setPose(pose);
    settle();
    const Image edited = picture();
    EXPECT_LT(difference(half(body, 0), half(edited, 0)), .001);
    EXPECT_GT(difference(half(body, line), half(edited, line)), .01);
    for (int i = 0; i < 2; ++i) screen_->key("Right");
    settle();
    EXPECT_GT(difference(half(edited, 0), half(picture(), 0)), .01);

    // Of a capture it is the frame.
    writeColouredCapture(*folder_ / "recorded", motion);
    viewer.editor().markSaved();
    viewer.loadMotion(*folder_ / "recorded");
    settle();
    for (int f : {0, 1}) {
        const Image seen = picture();
        EXPECT_NEAR(seen.pixel(line / 2, seen.height / 2)[f], 200, 3) << f;
        screen_->key("Right");
        settle();
    }
}

TEST_F(ViewerTest, ADividedPictureIsTheWholeOnes) {
    Viewer& viewer = open();
    const Image whole = picture();
    viewer.settings().split = Split::Meshes;  // the network moves nothing
    viewer.settings().divided = true;
    settle();
    const Image divided = picture();
    int differs = 0;
    const int line = viewer.panes()[1].x;
    for (int y = 0; y < whole.height - 120; ++y)
        for (int x = 0; x < whole.width; ++x)
            if (std::abs(x - line) > 12)
                differs += std::abs(whole.pixel(x, y)[1] - divided.pixel(x, y)[1]) > 2;
    EXPECT_EQ(differs, 0);
}

// What is compared with is followed on disk, as a training's state is, and may be missing.
TEST_F(ViewerTest, WhatIsComparedWithIsFollowed) {
    Viewer& viewer = open();
    EXPECT_THROW(viewer.compareWith(*folder_ / "nobody"), InputError);
    EXPECT_EQ(viewer.panes().size(), 1u);
    fs::copy(*folder_ / "avatar", *folder_ / "changing", fs::copy_options::recursive);
    viewer.compareWith(*folder_ / "changing");
    settle();
    EXPECT_EQ(bluePart(picture(), 0, picture().width), 0);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    writeBlue(*folder_ / "changing");
    await("the change to be seen", [&] {
        turn(1);
        return viewer.message().find("changed") != std::string::npos;
    });
    settle();
    EXPECT_GT(bluePart(picture(), 0, picture().width), .01);
}

// Which of the red, green and blue avatars are seen in these columns.
std::string coloursIn(const Image& image, int from, int to) {
    std::array<int, 3> seen{};
    for (int y = 0; y < image.height; ++y)
        for (int x = from; x < to; ++x)
            for (size_t c = 0; c < 3; ++c) {
                const uint8_t* rgb = image.pixel(x, y);
                seen[c] += rgb[c] > 200 && rgb[(c + 1) % 3] < 60 && rgb[(c + 2) % 3] < 60;
            }
    std::string names;
    for (size_t c = 0; c < 3; ++c)
        if (seen[c] > 60) names += "RGB"[c];
    return names;
}

class CompanyTest : public ViewerTest {
protected:
    // Of one colour, and as large as the shape says.
    fs::path writeOne(const std::string& name, size_t colour, float beta) {
        Avatar avatar = plainAvatar();
        for (size_t i = 0; i < avatar.texture.size(); ++i)
            avatar.texture[i] = i % 3 == colour ? 1.f : 0.f;
        avatar.betas[0] = beta;
        writeAvatar(*folder_ / name, avatar);
        return *folder_ / name;
    }
};

TEST_F(CompanyTest, ThreeAreSideBySide) {
    ViewerOptions options;
    options.avatar = writeOne("red", 0, 0);
    options.beside = {writeOne("green", 1, 1), writeOne("blue", 2, -1)};
    Viewer& viewer = open(options);
    ASSERT_EQ(viewer.panes().size(), 3u);
    awaitSilence();
    const Image three = picture();
    for (int i = 0; i < 3; ++i) {
        const Pane& pane = viewer.panes()[static_cast<size_t>(i)];
        EXPECT_EQ(coloursIn(three, pane.x + 2, pane.x + pane.width - 2), std::string(1, "RGB"[i]));
    }
    // The line is for two.
    const double yaw = viewer.camera().yaw;
    drag({double(viewer.panes()[1].x), 40}, {double(viewer.panes()[1].x) + 60, 40});
    EXPECT_EQ(viewer.panes().size(), 3u);
    EXPECT_NE(viewer.camera().yaw, yaw) << "it orbits there";
}

TEST_F(CompanyTest, SeveralStandInOneScene) {
    ViewerOptions options;
    options.avatar = writeOne("red", 0, 0);
    options.beside = {writeOne("green", 1, 1.5f), writeOne("blue", 2, -1.5f)};
    Viewer& viewer = open(options);
    viewer.settings().joints = false;
    viewer.settings().split = Split::Together;
    viewer.settings().apart = .8;
    viewer.camera().dolly(1.6);
    settle();
    awaitSilence();
    ASSERT_EQ(viewer.panes().size(), 1u);
    const Image row = picture();
    const int middle = row.width / 2;
    EXPECT_EQ(coloursIn(row, middle - 4, middle + 4), "R");
    EXPECT_NE(coloursIn(row, middle, row.width).find('G'), std::string::npos);
    EXPECT_NE(coloursIn(row, 0, middle).find('B'), std::string::npos);
    // Soles are on one level, however long the legs.
    const auto lowest = [&](size_t c) {
        for (int y = row.height - 1; y >= 0; --y)
            for (int x = 0; x < row.width; ++x) {
                const uint8_t* rgb = row.pixel(x, y);
                if (rgb[c] > 200 && rgb[(c + 1) % 3] < 60 && rgb[(c + 2) % 3] < 60) return y;
            }
        return -1;
    };
    EXPECT_NEAR(lowest(1), lowest(0), 3);
    EXPECT_NEAR(lowest(2), lowest(0), 3);

    // From the side the nearest hides the others.
    screen_->key("3");
    settle();
    const Image aside = picture();
    const std::string nearest = coloursIn(aside, middle - 3, middle + 3);
    EXPECT_NE(nearest.find('G'), std::string::npos) << nearest;
    EXPECT_EQ(nearest.find('R'), std::string::npos) << nearest;
    keyWith("Shift_L", "3");
    const std::string across = coloursIn(picture(), middle - 3, middle + 3);
    EXPECT_NE(across.find('B'), std::string::npos) << across;
    EXPECT_EQ(across.find('R'), std::string::npos) << across;

    // In one place what is further out is seen: the larger one's outline around the smaller one's.
    screen_->key("1");
    viewer.settings().apart = 0;
    settle();
    EXPECT_EQ(coloursIn(picture(), 0, row.width).find('G') != std::string::npos, true);
    // A film has all of them.
    viewer.settings().apart = .8;
    settle();
    viewer.startFilm(*folder_ / "row", {.size = 0});
    await("the film", [&] { return viewer.frame() && !viewer.working(); });
    const Image filmed = readImage(*folder_ / "row/0000.png");
    EXPECT_EQ(coloursIn(filmed, 0, filmed.width), "RGB");

    // One leaves, by the panel.
    screen_->key("n");
    settle();
    clickItem("without");
    awaitSilence();
    EXPECT_EQ(coloursIn(picture(), 0, viewer.panes()[0].width).find('B'), std::string::npos);
}

// Who is drawn first makes no difference.
TEST_F(CompanyTest, NearerSurfacesHideFartherOnes) {
    Device device;
    const Avatar avatar = readAvatar(*folder_ / "avatar");
    Scene one(device, avatar), two(device, avatar);
    const Shot rest = restShot(device, avatar, 128);
    Trans near = rest.trans;
    near[2] -= .1f;
    near[0] += .15f;
    one.setPose(rest.theta, rest.trans, avatar.betas);
    two.setPose(rest.theta, near, avatar.betas);
    OrbitCamera orbit;
    orbit.target = {0, 0, rest.trans[2]};
    const Camera camera = orbit.camera(128, 160);
    const std::vector<uint32_t> empty(128 * 160, 0xff303030u);
    for (int samples : {1, 2}) {
        const auto drawn = [&](Scene& first, Scene& second) {
            std::vector<float> depths(empty.size(), INFINITY);
            const auto behind =
                first.draw(MeshKind::Body, camera, orbit.view(), {}, empty, samples, {}, &depths);
            return second.draw(MeshKind::Body, camera, orbit.view(), {}, behind, samples, {},
                               &depths);
        };
        const std::vector<uint32_t> a = drawn(one, two), b = drawn(two, one);
        size_t differ = 0, seen = 0;
        for (size_t i = 0; i < a.size(); ++i) {
            differ += a[i] != b[i];
            seen += a[i] != empty[i];
        }
        EXPECT_GT(seen, a.size() / 20);
        // Where a pixel has samples of both, what was first there counts as what is behind.
        EXPECT_LE(differ, samples == 1 ? size_t{0} : seen / 20) << samples;
        std::vector<float> none(empty.size(), INFINITY);
        const auto alone =
            two.draw(MeshKind::Body, camera, orbit.view(), {}, empty, samples, {}, &none);
        EXPECT_EQ(alone, two.draw(MeshKind::Body, camera, orbit.view(), {}, empty, samples));
    }
}

}  // namespace
}  // namespace doppel::test
