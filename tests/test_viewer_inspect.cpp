// The inspector: which point of the surface is clicked on, and which frames show it.
#include "tests/viewer_test.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/data/body_render.h"

namespace doppel::test {
namespace {

TEST(SurfacePoint, TheNearestFaceIsMet) {
    // Two squares of two faces, two and three metres away.
    std::vector<float> verts;
    for (float z : {3.f, 2.f})
        for (float y : {-1.f, 1.f})
            for (float x : {-1.f, 1.f}) verts.insert(verts.end(), {x, y, z});
    const std::vector<int32_t> faces{0, 1, 2, 1, 3, 2, 4, 5, 6, 5, 7, 6};
    const auto hit = nearestHit(verts, faces, glm::dvec3(0), {.25, -.125, 1});
    ASSERT_TRUE(hit);
    EXPECT_EQ(hit->point.face, 3u);
    EXPECT_NEAR(hit->distance, 2, 1e-12);
    EXPECT_LT(glm::distance(placeOf(hit->point, verts, faces), {.5, -.25, 2}), 1e-12);
    EXPECT_LT(glm::distance(normalOf(hit->point.face, verts, faces), {0, 0, 4}), 1e-12);
    // From between them only the far one is in front; beside them there is nothing.
    EXPECT_LT(nearestHit(verts, faces, {0, 0, 2.5}, {0, 0, 1})->point.face, 2u);
    EXPECT_FALSE(nearestHit(verts, faces, glm::dvec3(0), {.6, 0, 1}));
}

class InspectorTest : public ViewerTest {
protected:
    void clickAt(glm::dvec2 place) {
        screen_->move(place.x, place.y);
        turn();
        screen_->press(1);
        turn();
        screen_->release(1);
        settle();
    }
};

TEST_F(InspectorTest, TellsWhatIsClickedOn) {
    Viewer& viewer = open();
    screen_->key("i");
    settle();
    ASSERT_TRUE(viewer.settings().panel);
    screen_->key("Home");
    settle();
    const Pose pose = viewer.editor().pose();
    clickAt(at(joint::kLeftElbow));  // a joint is not taken meanwhile
    EXPECT_EQ(viewer.editor().pose(), pose);
    EXPECT_FALSE(viewer.selected());
    ASSERT_TRUE(viewer.inspected());
    const Inspected found = *viewer.inspected();
    EXPECT_TRUE(found.part == kLeftUpperArm || found.part == kLeftForearm) << partName(found.part);

    // The same point by another way: in the picture it is where the mouse was.
    const Avatar avatar = readAvatar(*folder_ / "avatar");
    const Betas betas = viewer.editor().betas();
    EXPECT_EQ(avatar.body.part[found.vertex], found.part);
    EXPECT_EQ(found.bound,
              double{clampBounds(avatar.body, avatar.preset.mesh.clamps)[found.vertex]});
    EXPECT_GT(found.bound, 0);
    PosedMesh posed =
        BodyPoser(testDevice(), avatar.body).pose(thetaOf(pose), transOf(pose), betas);
    const glm::dvec3 place = placeOf(found.point, posed.verts, avatar.body.faces);
    const Pane& pane = viewer.panes().back();
    const glm::dvec3 onPane =
        projected(place, viewer.camera().view(), viewer.camera().camera(pane.width, pane.height));
    EXPECT_LT(glm::distance(glm::dvec2(onPane), at(joint::kLeftElbow)), 1);
    EXPECT_LT(onPane.z, viewer.jointOnScreen(joint::kLeftElbow).z) << "towards the eye";

    EXPECT_EQ(found.texel, glm::ivec2(found.uv * double(kTextureSize)));
    EXPECT_FALSE(found.origin) << "the avatar does not say";
    EXPECT_FALSE(viewer.sightings()) << "nor which frames it is from";
    EXPECT_NO_THROW(
        itemAt("not known: neither what plays nor what lies beside the avatar is the capture that "
               "it was trained on; open that"));

    clickAt({6, 200});  // beside the body
    EXPECT_FALSE(viewer.inspected());
    drag({6, 200}, {60, 200});
    EXPECT_FALSE(viewer.inspected()) << "a drag turns the camera";
    screen_->key("i");
    settle();
    clickAt(at(joint::kPelvis));
    EXPECT_FALSE(viewer.inspected());
    EXPECT_EQ(viewer.selected(), joint::kPelvis);
}

// Of a body that turns about itself, the front is seen from before and the back from behind.
TEST_F(InspectorTest, FindsTheTrainingFramesThatShowIt) {
    ViewerOptions options;
    options.avatar = *folder_ / "trained";
    options.motion = *folder_ / "turning";
    fs::copy(*folder_ / "avatar", options.avatar, fs::copy_options::recursive);
    Avatar avatar = readAvatar(options.avatar);
    avatar.texels = avatar.texture;
    avatar.texelsSeen.assign(size_t{kTextureSize} * kTextureSize, kFromOtherSide);
    writeAvatar(options.avatar, avatar);
    constexpr size_t kFrames = 21;  // once round
    writeColouredCapture(options.motion, turningMotion(kFrames));
    const Capture capture = readCapture(options.motion);
    // Trained on every other frame.
    std::vector<size_t> even;
    for (size_t f = 0; f < kFrames; f += 2) even.push_back(f);
    writeTrainingPoses(options.avatar, capture.subset(even), capture.subset(even));

    Viewer& viewer = open(options);
    screen_->key("i");
    settle();
    for (int behind : {0, 1}) {
        behind ? keyWith("Shift_L", "1") : screen_->key("1");
        screen_->key("Home");
        settle();
        clickAt(at(joint::kSpine3));
        ASSERT_TRUE(viewer.inspected());
        EXPECT_EQ(viewer.inspected()->part, kTorso);
        EXPECT_EQ(viewer.inspected()->origin, kFromOtherSide);
        ASSERT_TRUE(viewer.sightings());
        EXPECT_EQ(viewer.sightings()->frames, even.size());
        // Facing within 90 degrees, less where an arm is before it.
        EXPECT_GE(viewer.sightings()->seen, 3u);
        EXPECT_LE(viewer.sightings()->seen, 6u);
        ASSERT_TRUE(viewer.sightings()->best);
        const size_t best = *viewer.sightings()->best;
        if (behind)
            EXPECT_NEAR(double(best), 10, 2);  // 0.3 * 10 is half a turn
        else
            EXPECT_TRUE(best <= 2 || best >= 20) << best;
        clickItem("see that frame");
        EXPECT_EQ(viewer.timeline(), double(best));
        EXPECT_TRUE(viewer.settings().captureCamera);
        EXPECT_EQ(viewer.settings().backdrop, Backdrop::Capture);
        EXPECT_TRUE(viewer.inspected()) << "it is still known";
        // A click through the capture's camera leaves it where it is.
        clickAt(at(joint::kSpine3));
        EXPECT_TRUE(viewer.settings().captureCamera);
        EXPECT_TRUE(viewer.inspected());
        screen_->key("0");
        settle();
    }
}

// Without a motion, or with another one, it is the capture that [source] names.
TEST_F(InspectorTest, OpensTheCaptureOfTheTrainingByItself) {
    ViewerOptions options;
    options.avatar = *folder_ / "known/avatar";
    const fs::path recorded = *folder_ / "recordings/box";
    fs::create_directories(options.avatar.parent_path());
    writeColouredCapture(recorded, turningMotion(6));
    const Capture capture = readCapture(recorded);
    Avatar avatar = plainAvatar();
    avatar.provenance["capture_folder"] = captureFolder(options.avatar, recorded);
    EXPECT_EQ(avatar.provenance["capture_folder"], "../../recordings/box");
    writeAvatar(options.avatar, avatar);
    writeTrainingPoses(options.avatar, capture, capture);

    Viewer& viewer = open(options);
    screen_->key("i");
    settle();
    clickAt(at(joint::kSpine3));
    ASSERT_TRUE(viewer.sightings());
    EXPECT_EQ(viewer.sightings()->frames, 6u);
    EXPECT_EQ(viewer.frameCount(), 1) << "nothing plays yet";
    ASSERT_TRUE(viewer.sightings()->best);
    const size_t best = *viewer.sightings()->best;
    clickItem("see that frame");
    EXPECT_EQ(viewer.frameCount(), 6);
    EXPECT_EQ(viewer.timeline(), double(best));
    EXPECT_TRUE(viewer.settings().captureCamera);
    EXPECT_EQ(viewer.settings().backdrop, Backdrop::Capture);
    EXPECT_TRUE(viewer.sightings());

    // Beside the avatar it is found as well; another person's capture is not taken.
    fs::rename(recorded, *folder_ / "known/capture");
    EXPECT_TRUE(trainedOn(options.avatar, avatar));
    fs::create_directories(*folder_ / "linked");
    fs::create_directory_symlink(options.avatar, *folder_ / "linked/avatar");
    fs::rename(*folder_ / "known/capture", *folder_ / "linked/capture");
    EXPECT_TRUE(trainedOn(*folder_ / "linked/avatar/", avatar));
    Motion other = turningMotion(3);
    for (Trans& trans : other.trans) trans[2] += 1;
    writeColouredCapture(*folder_ / "known/capture", other);
    EXPECT_FALSE(trainedOn(options.avatar, avatar));
}

// What stands before the point hides it.
TEST_F(InspectorTest, WhatIsHiddenIsNotSeen) {
    const Avatar avatar = readAvatar(*folder_ / "avatar");
    TrainedFrame front{0, {}, {0, .45f, 3}};
    std::ranges::copy(uprightOrientation(0), front.theta.begin());
    TrainedFrame hidden = front;
    hidden.frame = 1;
    hidden.theta[3 * joint::kLeftShoulder + 1] = -1.9f;  // the arm before the chest
    const std::vector<Camera> cameras(2, Camera{300, 300, 150, 150, 300, 300});
    BodyPoser poser(testDevice(), avatar.body);
    const PosedMesh posed = poser.pose(hidden.theta, hidden.trans, avatar.betas);
    // The chest behind the fist.
    const auto hand = posed.joints[joint::kLeftHand];
    const glm::dvec3 ray(hand[0], hand[1], hand[2]);
    ASSERT_LT(hand[2], 2.6) << "towards the camera";
    const PosedMesh bare = poser.pose(front.theta, front.trans, avatar.betas);
    const auto hit = nearestHit(bare.verts, avatar.body.faces, glm::dvec3(0), ray);
    ASSERT_TRUE(hit);
    const std::vector<TrainedFrame> frames{front, hidden};
    const Sightings found = sightingsOf(testDevice(), avatar, frames, cameras, hit->point);
    EXPECT_EQ(found.frames, 2u);
    EXPECT_EQ(found.seen, 1u);
    EXPECT_EQ(found.best, 0u);
    // Outside of the picture it is not seen either.
    const std::vector<Camera> aside(2, Camera{300, 300, -900, 150, 300, 300});
    EXPECT_EQ(sightingsOf(testDevice(), avatar, frames, aside, hit->point).seen, 0u);
}

}  // namespace
}  // namespace doppel::test
