#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "engine/error.h"
#include "tests/files.h"
#include "tests/pose_test.h"
#include "trainer/motion/motion.h"
#include "viewer/pose/pose_editor.h"

namespace doppel {
namespace {

using test::bent;
using test::messageOf;
using test::removeKeys;
using test::turnOf;
using test::walk;

TEST(PoseEditor, UndoesGesturesAsAWhole) {
    PoseEditor editor(bent(0));
    EXPECT_FALSE(editor.canUndo());
    editor.beginGesture("move left_wrist");
    for (int i = 1; i <= 100; ++i) editor.setPose(bent(.01 * i));
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
    EXPECT_EQ(to.betas(), Betas{}) << "the shape is whose pose it was";
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
        {std::string(8, '['), "clipboard: expected a pose as JSON, found an error at byte 9"},
        {std::string(30000, '[') + std::string(30000, ']'),
         "clipboard: expected JSON nested at most 8 deep, found more at byte 8"},
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

// ---- keys ---------------------------------------------------------------------------------------

TEST(PoseEditor, KeepsKeysInOrder) {
    PoseEditor editor(bent(0));
    for (double time : {10., 0., 5.5}) {
        editor.goTo(time);
        editor.setPose(bent(time / 10));
        editor.setKeyframe(time);
    }
    ASSERT_EQ(editor.keyframes().size(), 3u);
    EXPECT_EQ(editor.keyframes()[1].time, 5.5);
    EXPECT_EQ(editor.keyframes()[2].pose, bent(1));
    // With keys on the timeline an edit is one of itself.
    editor.setPose(bent(.2));
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
    removeKeys(editor);
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
    editor.goTo(20);
    editor.setPose(later);
    const Pose middle = editor.poseAt(12.5);
    EXPECT_NEAR(glm::length(middle.rotation[joint::kLeftElbow] - glm::dvec3(0, -.3, 0)), 0, 1e-12);
    EXPECT_NEAR(middle.trans.x, .3, 1e-12);
    EXPECT_NEAR(glm::length(middle.rotation[0]), 175 * kDegree, 1e-9);
    EXPECT_EQ(editor.poseAt(10), pose);
    EXPECT_EQ(editor.poseAt(20), later);
    EXPECT_EQ(editor.poseAt(-5), pose);
    EXPECT_EQ(editor.poseAt(1e9), later);
}

// ---- over a motion ------------------------------------------------------------------------------

TEST(PoseEditor, WhatIsEditedOverAMotionIsStillThereWhenTheFrameComesAgain) {
    PoseEditor editor(bent(0));
    const auto motion = walk(60);
    editor.openMotion(motion);
    EXPECT_EQ(editor.pose(), motionPose(*motion, 0));
    editor.goTo(20);
    EXPECT_EQ(editor.pose(), motionPose(*motion, 20));
    EXPECT_FALSE(editor.modified());
    Pose edited = editor.pose();
    edited.rotation[joint::kHead] = {.5, 0, 0};
    edited.trans.y += .25;
    editor.beginGesture("nod");
    editor.setPose(edited);
    editor.endGesture();
    EXPECT_TRUE(editor.modified());
    for (double time : {0., 59., 21., 20.}) editor.goTo(time);
    EXPECT_EQ(editor.pose(), edited);

    // The layer fades in and out and leaves alone what was not edited.
    editor.setFade(8);
    double before = .5;
    for (int t = 20; t <= 28; ++t) {
        const Pose pose = editor.poseAt(t), under = motionPose(*motion, t);
        const double head = turnOf(pose, under, joint::kHead);
        EXPECT_LE(head, before + 1e-12) << t;
        EXPECT_NEAR(pose.trans.y - under.trans.y, .5 * head, .01) << t;
        EXPECT_EQ(pose.rotation[joint::kLeftElbow], under.rotation[joint::kLeftElbow]) << t;
        EXPECT_EQ(pose.rotation[0], under.rotation[0]) << t;
        EXPECT_NEAR(turnOf(editor.poseAt(40 - t), motionPose(*motion, 40 - t), joint::kHead), head,
                    1e-9);
        before = head;
    }
    EXPECT_NEAR(turnOf(editor.poseAt(24), motionPose(*motion, 24), joint::kHead), .25, .01);
    for (double t : {0., 12., 28., 59.}) EXPECT_EQ(editor.poseAt(t), motionPose(*motion, t)) << t;

    // A second key 4 frames on: from one to the other without a way back to the motion.
    editor.goTo(24);
    Pose second = motionPose(*motion, 24);
    second.rotation[joint::kHead] = {.7, 0, 0};
    editor.setPose(second);
    before = .5;
    for (double t : {21., 22., 23., 24.}) {
        const double head = turnOf(editor.poseAt(t), motionPose(*motion, t), joint::kHead);
        EXPECT_GT(head, before) << t;
        before = head;
    }
    EXPECT_NEAR(before, .7, 1e-9);
}

TEST(PoseEditor, UndoGoesToTheFrameAndBringsAllBack) {
    PoseEditor editor(bent(0), {1});
    const auto first = walk(40), second = walk(30);
    editor.openMotion(first);
    editor.goTo(10);
    Pose edited = editor.pose();
    edited.rotation[joint::kNeck] = {0, .3, 0};
    editor.setPose(edited, "turn neck");
    editor.goTo(30);
    editor.mirror();
    const Pose mirroredPose = editor.pose();
    editor.goTo(3);
    editor.setBetas({2});
    editor.openMotion(second);
    EXPECT_TRUE(editor.keyframes().empty());

    editor.undo();  // the motion
    EXPECT_EQ(editor.motion(), first);
    EXPECT_EQ(editor.keyframes().size(), 2u);
    editor.goTo(7);
    editor.undo();  // the shape has no frame
    EXPECT_EQ(editor.betas(), Betas{1});
    EXPECT_EQ(editor.time(), 7);
    editor.undo();
    EXPECT_EQ(editor.time(), 30);
    EXPECT_EQ(editor.pose(), motionPose(*first, 30));
    editor.undo();
    EXPECT_EQ(editor.time(), 10);
    EXPECT_EQ(editor.pose(), motionPose(*first, 10));
    editor.undo();
    EXPECT_EQ(editor.motion(), nullptr);
    EXPECT_EQ(editor.pose(), bent(0));
    EXPECT_FALSE(editor.canUndo());
    for (int i = 0; i < 3; ++i) editor.redo();
    EXPECT_EQ(editor.time(), 30);
    EXPECT_EQ(editor.pose(), mirroredPose);
    editor.goTo(10);
    EXPECT_EQ(editor.pose(), edited);
    editor.redo();
    editor.redo();
    EXPECT_EQ(editor.motion(), second);
    EXPECT_EQ(editor.betas(), Betas{2});
    EXPECT_FALSE(editor.canRedo());
}

TEST(PoseEditor, ResetsToTheMotion) {
    PoseEditor editor(bent(0));
    const auto motion = walk(40);
    editor.openMotion(motion);
    editor.goTo(10);
    Pose edited = editor.pose();
    edited.rotation[joint::kNeck] = edited.rotation[joint::kHead] = {0, .3, 0};
    editor.setPose(edited);
    editor.goTo(14);  // where the layer fades
    EXPECT_NE(editor.pose(), motionPose(*motion, 14));
    editor.resetJoint(joint::kNeck);
    EXPECT_EQ(editor.pose().rotation[joint::kNeck], motionPose(*motion, 14).rotation[joint::kNeck]);
    EXPECT_GT(turnOf(editor.pose(), motionPose(*motion, 14), joint::kHead), .01);
    editor.resetPose();
    EXPECT_EQ(editor.pose(), motionPose(*motion, 14));
    editor.goTo(10);
    EXPECT_EQ(editor.pose(), edited);
}

TEST(PoseEditor, KnowsWhatIsNotSaved) {
    PoseEditor editor(bent(0));
    EXPECT_FALSE(editor.modified());
    editor.setPose(bent(1));
    EXPECT_TRUE(editor.modified());
    editor.undo();
    EXPECT_FALSE(editor.modified());
    editor.redo();
    editor.markSaved();
    EXPECT_FALSE(editor.modified());
    editor.undo();
    EXPECT_FALSE(editor.modified()) << "as at the beginning: there is nothing to lose";
    editor.setBetas({1});
    EXPECT_TRUE(editor.modified());
    editor.markSaved();
    editor.openMotion(walk(10));
    editor.goTo(5);
    EXPECT_TRUE(editor.modified()) << "the shape";
    editor.resetBetas();
    EXPECT_FALSE(editor.modified());
    editor.setKeyframe(5);
    EXPECT_TRUE(editor.modified());
    editor.markSaved();
    editor.goTo(2);
    EXPECT_FALSE(editor.modified()) << "another frame is no edit";
    editor.setFade(3);
    EXPECT_TRUE(editor.modified());
    // A training that goes on has another shape now, which is nobody's edit.
    PoseEditor followed(bent(0), {1});
    followed.setPose(bent(1));
    followed.setOpenedBetas({2});
    EXPECT_EQ(followed.betas(), Betas{2});
    followed.undo();
    EXPECT_EQ(followed.betas(), Betas{2});
    EXPECT_FALSE(followed.modified());
}

TEST(PoseEditor, KeysThatAreRemovedAfterSavingAreMissed) {
    PoseEditor editor(bent(0));
    editor.openMotion(walk(10));
    editor.setKeyframe(5);
    editor.undo();
    EXPECT_FALSE(editor.modified()) << "no file has it";
    editor.setKeyframe(5);
    editor.markSaved();
    editor.removeKeyframe(5);
    EXPECT_TRUE(editor.modified()) << "the file has it still";
    editor.undo();
    EXPECT_FALSE(editor.modified());
    removeKeys(editor);
    EXPECT_TRUE(editor.modified());
    editor.openMotion(walk(10));
    EXPECT_FALSE(editor.modified()) << "another motion has keys of its own";
}

TEST(PoseEditor, CountsWhatWasOpened) {
    PoseEditor editor(bent(0));
    EXPECT_EQ(editor.opening(), 0u);
    editor.openMotion(walk(10));
    const uint64_t first = editor.opening();
    editor.setKeyframe(5);
    EXPECT_EQ(editor.opening(), first);
    const Take take = editor.take();
    editor.openTake(take, 0, "the same once more");
    EXPECT_NE(editor.opening(), first) << "it came from another place";
    editor.undo();
    EXPECT_EQ(editor.opening(), first);
    editor.undo();
    editor.undo();
    EXPECT_EQ(editor.opening(), 0u);
    editor.openMotion(walk(10));
    EXPECT_GT(editor.opening(), first) << "a number is nobody else's again";
}

// Whatever is done in whatever order, undoing all of it and doing it again ends where it was.
TEST(PoseEditor, UndoAndRedoAreWholeWhateverWasDone) {
    for (unsigned seed = 1; seed <= 20; ++seed) {
        std::mt19937 random(seed);
        const auto below = [&](int n) { return static_cast<int>(random() % unsigned(n)); };
        PoseEditor editor(bent(0), {}, 10000);
        std::vector<std::pair<Pose, size_t>> seen;  // after each step, at its time
        std::vector<double> times;
        for (int i = 0; i < 200; ++i) {
            const size_t steps = editor.steps();
            if (below(3) == 0) editor.goTo(below(40));
            Pose pose = editor.pose();
            pose.rotation[static_cast<size_t>(below(24))].x += .01 * (1 + below(50));
            switch (below(9)) {
                case 0:
                    editor.openMotion(below(2) ? walk(40) : nullptr);
                    break;
                case 1:
                    editor.setKeyframe(editor.time());
                    break;
                case 2:
                    editor.removeKeyframe(editor.time());
                    break;
                case 3:
                    editor.setBetas({static_cast<float>(below(100))});
                    break;
                case 4:
                    editor.setFade(below(20));
                    break;
                case 5:
                    editor.beginGesture("drag");
                    editor.setPose(pose);
                    if (below(2)) editor.cancelGesture();
                    editor.endGesture();
                    break;
                default:
                    editor.setPose(pose);
            }
            if (editor.steps() == steps) continue;
            ASSERT_EQ(editor.steps(), steps + 1);
            seen.emplace_back(editor.pose(), editor.keyframes().size());
            times.push_back(editor.time());
        }
        const size_t steps = editor.steps();
        ASSERT_EQ(seen.size(), steps);
        for (size_t i = steps; i-- > 0;) {
            editor.goTo(times[i]);
            EXPECT_EQ(editor.pose(), seen[i].first) << "seed " << seed << " step " << i;
            EXPECT_EQ(editor.keyframes().size(), seen[i].second);
            editor.undo();
        }
        EXPECT_FALSE(editor.canUndo());
        EXPECT_EQ(editor.pose(), bent(0));
        for (size_t i = 0; i < steps; ++i) {
            editor.redo();
            editor.goTo(times[i]);
            EXPECT_EQ(editor.pose(), seen[i].first) << "seed " << seed << " step " << i;
        }
        EXPECT_FALSE(editor.canRedo());
    }
}

TEST(PoseEditor, UndoBringsTheCameraBackWhereItIsFollowed) {
    PoseEditor editor;
    editor.setPose(bent(1));
    editor.moveCamera("front");
    EXPECT_EQ(editor.undoName(), "pose") << "the first one is where it stands";
    editor.moveCamera("left");
    editor.moveCamera("left");
    editor.setPose(bent(2));
    editor.moveCamera("top");
    EXPECT_EQ(editor.undoName(), "camera");
    editor.undo();
    EXPECT_EQ(editor.camera(), "left");
    EXPECT_EQ(editor.pose(), bent(2));
    editor.undo();
    EXPECT_EQ(editor.camera(), "left");
    EXPECT_EQ(editor.pose(), bent(1));
    editor.undo();
    EXPECT_EQ(editor.camera(), "front");
    for (int i = 0; i < 3; ++i) editor.redo();
    EXPECT_EQ(editor.camera(), "top");
    EXPECT_EQ(editor.pose(), bent(2));
    EXPECT_FALSE(editor.canRedo());
    editor.markSaved();
    editor.moveCamera("bottom");
    EXPECT_FALSE(editor.modified()) << "it is not part of the work";

    editor.undo();
    editor.undo();
    editor.forgetCamera();
    EXPECT_TRUE(editor.camera().empty());
    EXPECT_FALSE(editor.canRedo()) << "only the camera's";
    editor.undo();
    EXPECT_EQ(editor.pose(), bent(1));
    editor.undo();
    EXPECT_EQ(editor.pose(), Pose{});
    EXPECT_FALSE(editor.canUndo());
}

}  // namespace
}  // namespace doppel
