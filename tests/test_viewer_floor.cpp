// The floor: where it lies, what is drawn of it, and how high the avatar is above it.
#include "tests/viewer_test.h"
#include "viewer/picture/floor.h"

namespace doppel::test {
namespace {

TEST(Floor, LinesAreHalfAMetreApart) {
    // Looking straight down from two metres: 100 pixels are a metre.
    const Camera camera{200, 200, 100, 100, 200, 200};
    ToFloor above;
    above.rotation = glm::dmat3(1, 0, 0, 0, 0, 1, 0, -1, 0);  // x, z, -y of columns
    above.translation = {0, 2, 0};
    EXPECT_EQ(asGround(above).level, -2);
    const std::vector<uint32_t> grey(200 * 200, 0xff505050u);
    std::vector<float> shadow(grey.size());
    shadow[30 * 200 + 30] = .5f;
    std::vector<uint32_t> picture = grey;
    paintFloor(picture, camera, above, {0, 0}, 1, shadow);
    const auto at = [&](int x, int y) {
        return int(picture[static_cast<size_t>(y * 200 + x)] & 0xff);
    };
    for (int x : {50, 100, 150}) EXPECT_GT(std::max(at(x - 1, 80), at(x, 80)), 0x58) << x;
    for (int y : {50, 100, 150}) EXPECT_GT(std::max(at(80, y - 1), at(80, y)), 0x58) << y;
    EXPECT_GT(std::max(at(99, 80), at(100, 80)), std::max(at(49, 80), at(50, 80))) << "a metre";
    EXPECT_EQ(at(80, 80), 0x50);
    EXPECT_EQ(at(30, 30), 0x28);
    // From below it would hide the body.
    above.translation.y = -2;
    picture = grey;
    paintFloor(picture, camera, above, {0, 0}, 1, shadow);
    EXPECT_EQ(picture, grey);
}

TEST_F(ViewerTest, TheAvatarStandsOnAFloor) {
    Viewer& viewer = open();
    const Image without = picture();
    screen_->key("g");
    settle();
    ASSERT_TRUE(viewer.settings().floor);
    drag({20, 60}, {20, 110}, 2);  // from a little above
    const Image with = picture();
    screen_->key("g");
    settle();
    const Image same = picture();
    screen_->key("g");
    settle();
    const int chest = static_cast<int>(at(joint::kSpine3).y);
    int above = 0, below = 0;
    for (int y = 0; y < with.height; ++y)
        for (int x = 0; x < 200; ++x)  // the scale is to the right
            if (with.pixel(x, y)[1] != same.pixel(x, y)[1]) ++(y < chest ? above : below);
    EXPECT_EQ(above, 0);
    EXPECT_GT(below, 500);
    expectScreen(with, "floor");

    // As high as the body is, whose soles are on the floor.
    const Avatar avatar = readAvatar(*folder_ / "avatar");
    const std::vector<double> shaped =
        shapedVertices(avatar.body, std::vector<double>(avatar.betas.begin(), avatar.betas.end()));
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 1; i < shaped.size(); i += 3)
        low = std::min(low, shaped[i]), high = std::max(high, shaped[i]);
    EXPECT_NEAR(*viewer.height(MeshKind::Body), high - low, .02);
    // It keeps still under a pose that is edited.
    const double before = *viewer.height(MeshKind::Body);
    Pose pose = viewer.editor().pose();
    pose.trans.y -= .25;
    viewer.editor().setPose(pose);
    settle();
    EXPECT_NEAR(*viewer.height(MeshKind::Body), before + .25, 1e-4);
}

TEST_F(ViewerTest, TheFloorIsWhereAMotionsFeetStand) {
    ViewerOptions options;
    options.motion = *folder_ / "on-the-floor";
    Motion motion = turningMotion(12);
    writeColouredCapture(options.motion, motion);
    Viewer& viewer = open(options);
    screen_->key("g");
    settle();
    const double standing = *viewer.height(MeshKind::Body);
    EXPECT_GT(standing, 1.4);
    EXPECT_LT(standing, 2.1);
    screen_->key("Right");
    settle();
    EXPECT_NEAR(*viewer.height(MeshKind::Body), standing, .03);
    // Whose feet are everywhere has none.
    for (size_t f = 0; f < motion.size(); ++f) motion.trans[f][1] += .1f * float(f);
    const fs::path swims = *folder_ / "swims";
    writeColouredCapture(swims, motion);
    viewer.loadMotion(swims);
    settle();
    EXPECT_FALSE(viewer.height(MeshKind::Body));
    screen_->key("n");
    settle();
    EXPECT_NO_THROW(itemAt("no floor: the feet of this motion stand nowhere"));
}

// The root goes with the mouse, and the feet stay where they stand.
TEST_F(ViewerTest, TheFloorHoldsFeetWhileTheRootIsDragged) {
    Viewer& viewer = open();
    const PosedSkeleton began = viewer.posed();
    const auto moved = [&](size_t joint) {
        return glm::distance(viewer.posed().position[joint], began.position[joint]);
    };
    const glm::dvec2 pelvis = at(joint::kPelvis);
    drag(pelvis, pelvis + glm::dvec2(16, 24));
    EXPECT_GT(moved(joint::kLeftAnkle), .05) << "nothing holds them";
    keyWith("Control_L", "z");

    viewer.settings().holdFeet = true;
    drag(pelvis, pelvis + glm::dvec2(16, 24));
    EXPECT_GT(moved(joint::kPelvis), .05);
    EXPECT_LT(glm::distance(at(joint::kPelvis), pelvis + glm::dvec2(16, 24)), 3);
    for (size_t ankle : {joint::kLeftAnkle, joint::kRightAnkle}) EXPECT_LT(moved(ankle), .003);
    EXPECT_GT(moved(joint::kLeftKnee), .01) << "it bends";
    keyWith("Control_L", "z");
    // A leg that is dragged is not held, the other one is.
    const glm::dvec2 ankle = at(joint::kLeftAnkle);
    drag(ankle, ankle + glm::dvec2(20, -40));
    EXPECT_LT(glm::distance(at(joint::kLeftAnkle), ankle + glm::dvec2(20, -40)), 3);
    EXPECT_LT(moved(joint::kRightAnkle), .003);
}

// A hand that is pulled away takes the body along on its feet, unless a foot is pinned.
TEST_F(ViewerTest, FeetOnTheFloorStepAfterAHand) {
    Viewer& viewer = open();
    viewer.settings().holdFeet = true;
    const PosedSkeleton began = viewer.posed();
    const glm::dvec2 wrist = at(joint::kLeftWrist), goal = wrist + glm::dvec2(150, -20);
    const auto gone = [&](size_t joint) {
        return glm::distance(viewer.posed().position[joint], began.position[joint]);
    };
    drag(wrist, goal);
    EXPECT_LT(glm::distance(at(joint::kLeftWrist), goal), 4);
    EXPECT_GT(gone(joint::kLeftAnkle), .2) << "the foot on that side";
    EXPECT_GT(gone(joint::kPelvis), .1);
    for (size_t ankle : {joint::kLeftAnkle, joint::kRightAnkle})
        EXPECT_NEAR(viewer.posed().position[ankle].y, began.position[ankle].y, .01);
    keyWith("Control_L", "z");
    EXPECT_LT(gone(joint::kLeftAnkle), 1e-6);

    screen_->move(at(joint::kRightAnkle).x, at(joint::kRightAnkle).y);
    turn();
    screen_->key("p");
    turn();
    drag(wrist, goal);
    for (size_t ankle : {joint::kLeftAnkle, joint::kRightAnkle}) EXPECT_LT(gone(ankle), .01);
}

TEST_F(ViewerTest, WhatIsDraggedStopsAtTheFloor) {
    Viewer& viewer = open();
    const auto height = [&] { return *viewer.height(MeshKind::Body); };
    const double standing = height();
    const glm::dvec2 pelvis = at(joint::kPelvis);
    drag(pelvis, pelvis + glm::dvec2(0, 60));
    EXPECT_LT(height(), standing - .1) << "half of it is below";
    keyWith("Control_L", "z");
    viewer.settings().aboveFloor = true;
    drag(pelvis, pelvis + glm::dvec2(30, 60));
    EXPECT_NEAR(height(), standing, .004);
    EXPECT_NEAR(at(joint::kPelvis).x, pelvis.x + 30, 3) << "along the floor it goes";
    keyWith("Control_L", "z");
    const glm::dvec2 ankle = at(joint::kLeftAnkle);
    const double before = viewer.posed().position[joint::kLeftAnkle].y;  // down
    drag(ankle, ankle + glm::dvec2(10, 50));
    EXPECT_LT(viewer.posed().position[joint::kLeftAnkle].y, before + .01);
    drag(ankle, ankle + glm::dvec2(10, -50));
    EXPECT_LT(viewer.posed().position[joint::kLeftAnkle].y, before - .05) << "up it goes";
}

}  // namespace
}  // namespace doppel::test
