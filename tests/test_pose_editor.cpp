#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "tests/files.h"
#include "trainer/motion/motion.h"
#include "viewer/pose_editor.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

Pose bent(double angle) {
    Pose pose;
    pose.rotation[joint::kLeftElbow] = {0, -angle, 0};
    pose.trans = {angle, 0, 0};
    return pose;
}

TEST(PoseEditor, UndoesGesturesAsAWhole) {
    PoseEditor editor(bent(0));
    EXPECT_FALSE(editor.canUndo());
    editor.beginGesture("move left_wrist");
    for (int i = 1; i <= 100; ++i) editor.setPose(bent(.01 * i));
    EXPECT_EQ(editor.gestureBegan(), bent(0));
    EXPECT_EQ(editor.steps(), 0u);
    editor.endGesture();
    EXPECT_EQ(editor.steps(), 1u);
    EXPECT_EQ(editor.undoName(), "move left_wrist");
    editor.beginGesture("again");
    editor.setPose(bent(2));
    editor.endGesture();

    editor.undo();
    EXPECT_EQ(editor.pose(), bent(1));
    EXPECT_EQ(editor.redoName(), "again");
    editor.undo();
    EXPECT_EQ(editor.pose(), bent(0));
    EXPECT_FALSE(editor.canUndo());
    editor.undo();
    EXPECT_EQ(editor.pose(), bent(0));
    editor.redo();
    editor.redo();
    EXPECT_EQ(editor.pose(), bent(2));
    EXPECT_FALSE(editor.canRedo());
    editor.redo();
    EXPECT_EQ(editor.pose(), bent(2));

    // A change after undo forgets what was undone.
    editor.undo();
    editor.setPose(bent(.5), "nudge");
    EXPECT_FALSE(editor.canRedo());
    EXPECT_EQ(editor.undoName(), "nudge");
    editor.undo();
    EXPECT_EQ(editor.pose(), bent(1));
}

TEST(PoseEditor, KeepsNoStepWhereNothingChanged) {
    PoseEditor editor(bent(0));
    editor.beginGesture("click");
    editor.endGesture();
    editor.beginGesture("there and back");
    editor.setPose(bent(1));
    EXPECT_TRUE(editor.canUndo());
    editor.setPose(bent(0));
    EXPECT_FALSE(editor.canUndo());
    editor.endGesture();
    editor.endGesture();
    editor.setPose(bent(0));
    editor.resetPose();
    editor.mirror();
    editor.clearKeyframes();
    EXPECT_FALSE(editor.removeKeyframe(3));
    EXPECT_EQ(editor.steps(), 0u);
    EXPECT_EQ(editor.pose(), bent(0));
}

TEST(PoseEditor, CancelsAGesture) {
    PoseEditor editor(bent(0));
    editor.beginGesture("drag");
    editor.setPose(bent(1));
    editor.cancelGesture();
    EXPECT_EQ(editor.pose(), bent(0));
    EXPECT_EQ(editor.steps(), 0u);
    // Undo in the middle of a drag is the same.
    editor.beginGesture("drag");
    editor.setPose(bent(1));
    editor.undo();
    EXPECT_EQ(editor.pose(), bent(0));
    EXPECT_FALSE(editor.inGesture());
    // A gesture whose end was lost (the button came up outside of the window) ends with the next.
    editor.beginGesture("first");
    editor.setPose(bent(1));
    editor.beginGesture("second");
    editor.setPose(bent(2));
    editor.endGesture();
    EXPECT_EQ(editor.steps(), 2u);
    editor.undo();
    EXPECT_EQ(editor.pose(), bent(1));
}

TEST(PoseEditor, ForgetsTheOldestSteps) {
    PoseEditor editor(bent(0), {}, 5);
    for (int i = 1; i <= 20; ++i) editor.setPose(bent(i));
    EXPECT_EQ(editor.steps(), 5u);
    for (int i = 0; i < 50; ++i) editor.undo();
    EXPECT_EQ(editor.pose(), bent(15));
    for (int i = 0; i < 50; ++i) editor.redo();
    EXPECT_EQ(editor.pose(), bent(20));
}

TEST(PoseEditor, ResetsAndMirrors) {
    const Betas betas{1, 2};
    PoseEditor editor(bent(.5), betas);
    editor.setBetas({3});
    Pose pose = bent(1);
    pose.rotation[joint::kHead] = {.1, .2, .3};
    editor.setPose(pose);
    editor.resetJoint(joint::kLeftElbow);
    EXPECT_EQ(editor.undoName(), "reset left_elbow");
    EXPECT_EQ(editor.pose().rotation[joint::kLeftElbow], bent(.5).rotation[joint::kLeftElbow]);
    EXPECT_EQ(editor.pose().rotation[joint::kHead], pose.rotation[joint::kHead]);
    EXPECT_EQ(editor.pose().trans, pose.trans);
    editor.mirror();
    EXPECT_EQ(editor.pose().rotation[joint::kRightElbow], glm::dvec3(0, .5, 0));
    EXPECT_EQ(editor.pose().rotation[joint::kHead], glm::dvec3(.1, -.2, -.3));
    editor.resetPose();
    EXPECT_EQ(editor.pose(), bent(.5));
    EXPECT_EQ(editor.betas(), Betas{3});
    editor.resetBetas();
    EXPECT_EQ(editor.betas(), betas);
    for (int i = 0; i < 6; ++i) editor.undo();
    EXPECT_EQ(editor.pose(), bent(.5));
    EXPECT_EQ(editor.betas(), betas);
    EXPECT_FALSE(editor.canUndo());

    // A timeline moves on: no step, and resets go to what it shows.
    editor.show(bent(.7));
    EXPECT_FALSE(editor.canUndo());
    editor.setPose(bent(2));
    editor.resetPose();
    EXPECT_EQ(editor.pose(), bent(.7));
}

// ---- clipboard ----------------------------------------------------------------------------------

TEST(PoseEditor, PastesWhatItCopies) {
    Pose pose;
    for (size_t j = 0; j < joint::kCount; ++j)
        pose.rotation[j] = glm::dvec3(.1, -1. / 3, 1e-7) * static_cast<double>(j);
    pose.trans = {.1, 2.123456789012345, -3};
    const Betas betas{.1f, -2.5f, 1.f / 3};
    const PoseEditor from(pose, betas);
    PoseEditor to;
    to.paste(from.copy());
    EXPECT_EQ(to.pose(), pose);
    EXPECT_EQ(to.betas(), betas);
    EXPECT_EQ(to.undoName(), "paste");
    to.undo();
    EXPECT_EQ(to.pose(), Pose{});
    EXPECT_NE(from.copy().find("\"left_wrist\": ["), std::string::npos);

    // A part of a pose: the rest keeps its values.
    to.paste(R"({"doppel_pose":1,"joints":{"left_wrist":[0.5,0,-1]}})");
    Pose expected;
    expected.rotation[joint::kLeftWrist] = {.5, 0, -1};
    EXPECT_EQ(to.pose(), expected);
    to.paste(R"({"trans":[1,2,3],"doppel_pose":1})");
    expected.trans = {1, 2, 3};
    EXPECT_EQ(to.pose(), expected);
    EXPECT_EQ(to.betas(), Betas{});
}

TEST(PoseEditor, RefusesWhatIsNoPose) {
    const std::string name(300, 'x');
    const std::vector<std::pair<std::string, std::string>> cases = {
        {"", "clipboard: expected a pose as JSON, found an error at byte 1"},
        {"hello", "clipboard: expected a pose as JSON, found an error at byte 1"},
        {"[1,2]", "clipboard: expected a pose, {\"doppel_pose\": 1, …}, found [1,2]"},
        {"{}",
         "clipboard: expected a pose, {\"doppel_pose\": 1, …}, found an object without "
         "doppel_pose"},
        {R"({"doppel_pose":2,"trans":[1,2,3]})",
         "clipboard: doppel_pose: expected version 1, found 2"},
        {R"({"doppel_pose":"1","trans":[1,2,3]})",
         "clipboard: doppel_pose: expected version 1, found \"1\""},
        {R"({"doppel_pose":1})", "clipboard: expected joints, trans or betas, found none of them"},
        {R"({"doppel_pose":1,"joint":{}})",
         "clipboard: expected joints, trans and betas, found \"joint\""},
        {R"({"doppel_pose":1,"joints":[1]})",
         "clipboard: joints: expected an object of rotations, found [1]"},
        {R"({"doppel_pose":1,"joints":{"left_wing":[1,2,3]}})",
         "clipboard: joints: expected names such as left_wrist, found \"left_wing\""},
        {R"({"doppel_pose":1,"joints":{"head":[1,2]}})",
         "clipboard: joints: head: expected 3 numbers from -1000 to 1000, found 2 of them"},
        {R"({"doppel_pose":1,"joints":{"head":[1,2,null]}})",
         "clipboard: joints: head: expected 3 numbers from -1000 to 1000, found null"},
        {R"({"doppel_pose":1,"joints":{"head":7}})",
         "clipboard: joints: head: expected 3 numbers from -1000 to 1000, found 7"},
        {R"({"doppel_pose":1,"trans":[0,1e300,0]})",
         "clipboard: trans: expected 3 numbers from -10000 to 10000, found 1e+300"},
        {R"({"doppel_pose":1,"trans":[0,1e999,0]})",
         "clipboard: expected finite numbers, found one that is too large"},
        {R"({"doppel_pose":1,"trans":[0,NaN,0]})",
         "clipboard: expected a pose as JSON, found an error at byte 29"},
        {R"({"doppel_pose":1,"betas":[1,2,3]})",
         "clipboard: betas: expected 10 numbers from -100 to 100, found 3 of them"},
        {R"({"doppel_pose":1,"joints":{"head":[1,1,1],"nose":[0,0,0]}})",
         "clipboard: joints: expected names such as left_wrist, found \"nose\""},
        {std::string(70000, ' '), "clipboard: expected a pose of at most 65536 bytes, found 70000"},
        {std::string(60000, '['),
         "clipboard: expected a pose as JSON, found an error at byte "
         "60001"},
    };
    PoseEditor editor(bent(1), {1});
    for (const auto& [text, sentence] : cases) {
        EXPECT_EQ(messageOf<InputError>([&] { editor.paste(text); }), sentence);
        EXPECT_EQ(editor.pose(), bent(1));
        EXPECT_EQ(editor.betas(), Betas{1});
        EXPECT_EQ(editor.steps(), 0u);
    }
    // What is shown of it is short and on one line.
    const std::string shown = messageOf<InputError>(
        [&] { editor.paste("{\"doppel_pose\":1,\"joints\":{\"a\\n" + name + "\":[]}}"); });
    EXPECT_LT(shown.size(), 160u);
    EXPECT_EQ(shown.find('\n'), std::string::npos);
}

// ---- keyframes ----------------------------------------------------------------------------------

TEST(PoseEditor, KeepsKeyframesInOrder) {
    PoseEditor editor(bent(0));
    for (double time : {10., 0., 5.5}) {
        editor.setPose(bent(time / 10));
        editor.setKeyframe(time);
    }
    ASSERT_EQ(editor.keyframes().size(), 3u);
    EXPECT_EQ(editor.keyframes()[1].time, 5.5);
    EXPECT_EQ(editor.keyframes()[2].pose, bent(1));
    editor.setPose(bent(.2));
    editor.setKeyframe(5.5);
    ASSERT_EQ(editor.keyframes().size(), 3u);
    EXPECT_EQ(editor.keyframes()[1].pose, bent(.2));
    EXPECT_TRUE(editor.removeKeyframe(5.5));
    EXPECT_FALSE(editor.removeKeyframe(5.5));
    EXPECT_EQ(editor.undoName(), "remove keyframe");
    editor.undo();
    ASSERT_EQ(editor.keyframes().size(), 3u);
    editor.undo();
    EXPECT_EQ(editor.keyframes()[1].pose, bent(.55));
    EXPECT_EQ(messageOf<InputError>(
                  [&] { editor.setKeyframe(std::numeric_limits<double>::quiet_NaN()); }),
              "keyframe: expected a time from -10000000 to 10000000 frames, found nan");
    editor.clearKeyframes();
    EXPECT_TRUE(editor.keyframes().empty());
    EXPECT_EQ(editor.poseAt(4), editor.pose());
}

TEST(PoseEditor, InterpolatesTheShortWay) {
    PoseEditor editor;
    Pose pose = bent(.2);
    // Axis-angle numbers far apart, rotations near each other: 170 and 190 degrees about y.
    constexpr double kDegree = 3.14159265358979323846 / 180;
    pose.rotation[0] = {0, 170 * kDegree, 0};
    editor.setPose(pose);
    editor.setKeyframe(10);
    Pose later = bent(.6);
    later.rotation[0] = {0, -170 * kDegree, 0};
    editor.setPose(later);
    editor.setKeyframe(20);
    const Pose middle = editor.poseAt(12.5);
    EXPECT_NEAR(glm::length(middle.rotation[joint::kLeftElbow] - glm::dvec3(0, -.3, 0)), 0, 1e-12);
    EXPECT_NEAR(middle.trans.x, .3, 1e-12);
    EXPECT_NEAR(glm::length(middle.rotation[0]), 175 * kDegree, 1e-9);
    EXPECT_EQ(editor.poseAt(10), pose);
    EXPECT_EQ(editor.poseAt(20), later);
    EXPECT_EQ(editor.poseAt(-5), pose);
    EXPECT_EQ(editor.poseAt(1e9), later);
}

TEST(PoseEditor, SavesMotionsThatAreReadBack) {
    Folder folder;
    PoseEditor editor({}, {.5f, -1});
    EXPECT_EQ(messageOf<InputError>([&] { editor.saveKeyframes(folder / "poses.npz", 30); }),
              (folder / "poses.npz").string() +
                  ": expected keyframes to save, found none; set one first");
    EXPECT_TRUE(folder.names().empty());
    for (double time : {0., 10., 16.}) {
        editor.setPose(bent(time / 10));
        editor.setKeyframe(time);
    }
    editor.saveKeyframes(folder / "keys.npz", 24);
    const Motion keys = readMotion(folder / "keys.npz");
    ASSERT_EQ(keys.size(), 3u);
    EXPECT_EQ(keys.fps, 24);
    EXPECT_EQ(keys.betas, editor.betas());
    for (size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(keys.theta[i], thetaOf(editor.keyframes()[i].pose));
        EXPECT_EQ(keys.trans[i], transOf(editor.keyframes()[i].pose));
    }

    // 16 frames at 24 a second in 48 a second: 33 of them.
    editor.saveSampled(folder / "sampled.npz", 24, 48);
    const Motion sampled = readMotion(folder / "sampled.npz");
    ASSERT_EQ(sampled.size(), 33u);
    EXPECT_EQ(sampled.fps, 48);
    EXPECT_EQ(sampled.theta[20], keys.theta[1]);
    EXPECT_EQ(sampled.theta[32], keys.theta[2]);
    EXPECT_EQ(sampled.theta[7], thetaOf(editor.poseAt(3.5)));

    PoseEditor other;
    other.loadKeyframes(folder / "keys.npz");
    ASSERT_EQ(other.keyframes().size(), 3u);
    EXPECT_EQ(other.keyframes()[2].time, 16);
    EXPECT_EQ(thetaOf(other.keyframes()[1].pose), keys.theta[1]);
    EXPECT_EQ(other.betas(), editor.betas());
    other.undo();
    EXPECT_TRUE(other.keyframes().empty());
    EXPECT_EQ(other.betas(), Betas{});
    other.loadKeyframes(folder / "sampled.npz");
    EXPECT_EQ(other.keyframes().size(), 33u);
    EXPECT_EQ(other.keyframes()[5].time, 5);

    Npz arrays = readNpz(folder / "keys.npz");
    arrays.set("key_times", Array::f64({3}, std::vector<double>{0, 8, 8}));
    writeNpz(folder / "twice.npz", arrays, false);
    EXPECT_EQ(messageOf<InputError>([&] { other.loadKeyframes(folder / "twice.npz"); }),
              (folder / "twice.npz").string() +
                  ": key_times: expected growing times up to 10000000 frames, found 8 in row 2");
    EXPECT_EQ(other.keyframes().size(), 33u);

    EXPECT_NE(messageOf<InputError>([&] {
                  editor.saveSampled(folder / "x.npz", 30, 0);
              }).find("fps: expected frames per second"),
              std::string::npos);
    editor.setKeyframe(9e6);
    EXPECT_NE(messageOf<InputError>([&] {
                  editor.saveSampled(folder / "x.npz", 1, 30);
              }).find("expected at most"),
              std::string::npos);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"keys.npz", "sampled.npz", "twice.npz"}));
}

}  // namespace
}  // namespace doppel
