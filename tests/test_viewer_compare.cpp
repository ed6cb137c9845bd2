// Two avatars, meshes or textures in one picture.
#include "tests/viewer_test.h"

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
    for (int i = 0; i < 100 && viewer.visibleMessages() > 0; ++i) turn(1);
    settle();
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
    EXPECT_EQ(viewer.panes().size(), 1u);
    EXPECT_EQ(bluePart(picture(), 0, width), 0);
    for (size_t panes : {2u, 2u, 2u, 1u}) {
        screen_->key("b");
        settle();
        EXPECT_EQ(viewer.panes().size(), panes);
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

}  // namespace
}  // namespace doppel::test
