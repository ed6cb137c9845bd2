// What is seen of a layer that overrides, and takes and sessions as files.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <set>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/npz.h"
#include "tests/files.h"
#include "tests/pose_test.h"
#include "trainer/motion/motion.h"
#include "viewer/pose/pose_editor.h"
#include "viewer/pose/pose_text.h"
#include "viewer/recovery.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bent;
using test::bytesOf;
using test::Folder;
using test::messageOf;
using test::removeKeys;
using test::turnOf;
using test::walk;

std::set<std::string> namesIn(const fs::path& folder) {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder))
        names.insert(entry.path().filename().string());
    return names;
}

TEST(Take, KeysAloneAreReadBack) {
    Folder folder;
    PoseEditor editor({}, {.5f, -1});
    for (double time : {0., 10., 16.}) {
        editor.goTo(time);
        editor.setPose(bent(time / 10));
        editor.setKeyframe(time);
    }
    writeTake(folder / "keys.npz", editor.take(), 24);
    const Motion keys = readMotion(folder / "keys.npz");
    ASSERT_EQ(keys.size(), 3u);
    EXPECT_EQ(keys.fps, 24);
    EXPECT_EQ(keys.betas, editor.betas());
    for (size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(keys.theta[i], thetaOf(editor.keyframes()[i].pose));
        EXPECT_EQ(keys.trans[i], transOf(editor.keyframes()[i].pose));
    }
    const std::optional<Take> take = readTake(folder / "keys.npz");
    ASSERT_TRUE(take);
    EXPECT_EQ(take->motion, nullptr);
    fs::copy(folder / "keys.npz", folder / "KEYS.NPZ");
    EXPECT_TRUE(readTake(folder / "KEYS.NPZ")) << "however the name is written";
    PoseEditor other;
    other.openTake(*take, 10, "open keys");
    ASSERT_EQ(other.keyframes().size(), 3u);
    EXPECT_EQ(other.keyframes()[2].time, 16);
    EXPECT_EQ(thetaOf(other.pose()), keys.theta[1]);
    EXPECT_EQ(other.betas(), editor.betas());
    other.undo();
    EXPECT_TRUE(other.keyframes().empty());
    EXPECT_EQ(other.betas(), Betas{});
    EXPECT_EQ(other.time(), 0);
}

TEST(Take, ALayerIsSavedAsItIsSeenAndReadBackAsKeys) {
    Folder folder;
    PoseEditor editor({}, {.5f, -1});
    const auto motion = walk(30);
    editor.openMotion(motion);
    editor.setFade(5);
    editor.setBlend(Layer::Blend::Override);
    for (double time : {4., 20.}) {
        editor.goTo(time);
        Pose pose = editor.pose();
        pose.rotation[joint::kHead] = {.4, 0, 0};
        editor.setPose(pose);
    }
    writeTake(folder / "poses.npz", editor.take(), 24);
    const Motion seen = readMotion(folder / "poses.npz");
    ASSERT_EQ(seen.size(), 30u);
    EXPECT_EQ(seen.fps, 24);
    for (size_t i = 0; i < 30; ++i) {
        EXPECT_EQ(seen.theta[i], thetaOf(editor.poseAt(double(i)))) << i;
        EXPECT_EQ(seen.trans[i], transOf(editor.poseAt(double(i)))) << i;
    }
    EXPECT_EQ(seen.theta[12], motion->theta[12]) << "beyond the fades";
    const std::optional<Take> take = readTake(folder / "poses.npz");
    ASSERT_TRUE(take && take->motion);
    EXPECT_EQ(take->motion->theta, motion->theta);
    EXPECT_EQ(take->motion->trans, motion->trans);
    EXPECT_EQ(take->layer, (Layer{5, Layer::Blend::Override}));
    EXPECT_EQ(take->betas, editor.betas());
    ASSERT_EQ(take->keys.size(), 2u);
    EXPECT_EQ(take->keys[1].time, 20);
    for (double t : {3., 4., 6., 20., 23.})
        EXPECT_LT(turnOf(poseAt(*take, t), editor.poseAt(t), joint::kHead), 1e-6) << t;

    // Without keys it is a motion like any other; one pose is one, too.
    removeKeys(editor);
    writeTake(folder / "motion.npz", editor.take(), 24);
    EXPECT_FALSE(readTake(folder / "motion.npz"));
    EXPECT_EQ(readMotion(folder / "motion.npz").theta, motion->theta);
    writeTake(folder / "pose.npz", PoseEditor(bent(1)).take(), 24);
    EXPECT_EQ(readMotion(folder / "pose.npz").size(), 1u);
}

// Joints that a key changes are held as it has them, whatever the motion does meanwhile.
TEST(Take, AnOverrideHoldsWhatWasEdited) {
    const auto motion = walk(60);
    PoseEditor editor;
    editor.openMotion(motion);
    editor.setFade(8);
    ASSERT_GT(turnOf(motionPose(*motion, 20), motionPose(*motion, 24), joint::kLeftElbow) +
                  turnOf(motionPose(*motion, 20), motionPose(*motion, 24), joint::kLeftHip),
              .01)
        << "it moves";
    const auto edit = [&](double time, double height) {
        editor.goTo(time);
        Pose pose = motionPose(*motion, time);
        for (size_t j : {joint::kLeftHip, joint::kPelvis, joint::kLeftElbow})
            pose.rotation[j] = {.1, .8, -.2};
        pose.trans = {0, height, 3};
        editor.setPose(pose);
    };
    edit(20, 1);
    edit(24, 2);
    const Pose added = editor.poseAt(22);
    editor.setBlend(Layer::Blend::Override);
    for (double t : {20., 21., 22., 23., 24.}) {
        const Pose pose = editor.poseAt(t), under = motionPose(*motion, t);
        for (size_t j : {joint::kLeftHip, joint::kPelvis, joint::kLeftElbow})
            EXPECT_LT(glm::length(pose.rotation[j] - glm::dvec3(.1, .8, -.2)), 1e-9) << t;
        EXPECT_NEAR(pose.trans.z, 3, 1e-9) << t;
        EXPECT_EQ(pose.rotation[joint::kRightKnee], under.rotation[joint::kRightKnee]) << t;
    }
    EXPECT_NEAR(editor.poseAt(22).trans.y, 1.5, 1e-9);
    EXPECT_NE(editor.poseAt(22), added);
    // In and out by a smooth step, and the motion's own beyond.
    for (double t : {12., 13., 15., 17., 19., 20.}) {
        const Pose pose = editor.poseAt(t), under = motionPose(*motion, t);
        const double x = (20 - t) / 8, weight = 1 - x * x * (3 - 2 * x);
        EXPECT_NEAR(pose.trans.y, under.trans.y + weight * (1 - under.trans.y), 1e-9) << t;
        EXPECT_NEAR(turnOf(pose, under, joint::kLeftHip),
                    weight * turnOf(editor.poseAt(20), under, joint::kLeftHip), .02)
            << t;
    }
    for (double t : {0., 12., 32., 59.}) EXPECT_EQ(editor.poseAt(t), motionPose(*motion, t)) << t;
    // A key that leaves a joint alone does not hold it.
    editor.goTo(20);
    Pose pose = editor.pose();
    pose.rotation[joint::kHead] = {.5, 0, 0};
    editor.setPose(pose);
    EXPECT_EQ(editor.poseAt(24).rotation[joint::kHead],
              motionPose(*motion, 24).rotation[joint::kHead]);
    EXPECT_EQ(editor.undoName(), "pose");
    editor.undo();
    editor.undo();
    EXPECT_EQ(editor.poseAt(22), added) << "the choice is a step as others are";
}

TEST(Take, RefusesFilesThatAreWrong) {
    Folder folder;
    PoseEditor editor;
    editor.openMotion(walk(6));
    for (double time : {1., 3., 5.}) {
        editor.goTo(time);
        editor.setKeyframe(time);
    }
    writeTake(folder / "good.npz", editor.take(), 30);
    const std::string file = (folder / "bad.npz").string();
    const auto refusal = [&](const std::function<void(Npz&)>& spoil) {
        Npz arrays = readNpz(folder / "good.npz");
        spoil(arrays);
        writeNpz(file, arrays, false);
        return messageOf<InputError>([&] { readTake(file); });
    };
    EXPECT_EQ(refusal([](Npz& a) {
                  a.set("key_times", Array::f64({3}, std::vector<double>{0, 8, 8}));
              }),
              file + ": key_times: expected growing times up to 10000000 frames, found 8 in row 2");
    EXPECT_NE(refusal([](Npz& a) {
                  a.set("key_times", Array::f64({2}, std::vector<double>{0, 8}));
              }).find("key_global_orient"),
              std::string::npos);
    EXPECT_EQ(refusal([](Npz& a) { a.set("key_fade", Array::scalarF64(-1)); }),
              file + ": key_fade: expected 0 to 1000 frames, found -1");
    EXPECT_EQ(refusal([](Npz& a) { a.set("key_blend", Array::scalarF64(.5)); }),
              file + ": key_blend: expected 0 (add) or 1 (override), found 0.5");
    Npz former = readNpz(folder / "good.npz");  // as files were before
    former.remove("key_blend");
    writeNpz(folder / "former.npz", former, false);
    EXPECT_EQ(readTake(folder / "former.npz")->layer, Layer{});
    EXPECT_NE(refusal([](Npz& a) { a.remove("motion_transl"); }).find("motion_transl"),
              std::string::npos);
    EXPECT_NE(refusal([](Npz& a) {
                  std::vector<float> wild(9, std::numeric_limits<float>::infinity());
                  a.set("key_transl", Array::f32({3, 3}, wild));
              }).find(file + ": key_transl"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  writeTake(file, editor.take(), 0);
              }).find("fps: expected frames per second"),
              std::string::npos);
}

TEST(Session, SaysAllThatWasEdited) {
    Session session;
    session.avatar = "/home/me/avatar";
    session.motion = "/home/me/box";
    session.frames = "0:50";
    session.when = "2024-05-06 07:08";
    session.time = 7;
    session.take.layer = {3, Layer::Blend::Override};
    session.take.betas = {.5f, -1};
    session.take.pose = bent(1. / 3);
    session.take.keys = {{2, bent(.1)}, {7, bent(1e-9)}};
    session.edited = false;
    session.worn = {{"hair", "/home/me/she"}, {"top", "/home/me/he"}};
    const Session read = readSessionText(sessionText(session), "here");
    EXPECT_EQ(read.avatar, session.avatar);
    EXPECT_EQ(read.motion, session.motion);
    EXPECT_EQ(read.frames, session.frames);
    EXPECT_EQ(read.when, session.when);
    EXPECT_EQ(read.time, 7);
    EXPECT_EQ(read.take.layer, session.take.layer);
    EXPECT_EQ(read.take.betas, session.take.betas);
    EXPECT_EQ(read.take.pose, session.take.pose);
    EXPECT_EQ(read.take.keys, session.take.keys);
    EXPECT_EQ(read.edited, session.edited);
    EXPECT_EQ(read.worn, session.worn);

    for (const auto& [text, sentence] : std::vector<std::pair<std::string, std::string>>{
             {"", "here: expected a session as JSON, found an error at byte 1"},
             {"{}", "here: expected a session, {\"doppel_session\": 1, …}, found another object"},
             {"{\"doppel_session\":1}", "here: avatar: it is missing"}})
        EXPECT_EQ(messageOf<InputError>([&] { readSessionText(text, "here"); }), sentence);
    const std::string good = sessionText(session);
    const auto spoilt = [&](const std::string& what, const std::string& by) {
        std::string text = good;
        const size_t at = text.find(what);
        EXPECT_NE(at, std::string::npos) << what;
        text.replace(at, what.size(), by);
        return messageOf<InputError>([&] { readSessionText(text, "here"); });
    };
    EXPECT_EQ(spoilt("\"time\":7.0,\"trans\"", "\"time\":1.0,\"trans\""),
              "here: keys: 1: time: expected growing times, found 1 after 2");
    EXPECT_EQ(spoilt("\"fade\":3.0", "\"fade\":-3.0"),
              "here: fade: expected a number from 0 to 1000, found -3.0");
    EXPECT_EQ(spoilt("\"overrides\":true", "\"overrides\":1"),
              "here: overrides: expected true or false, found 1");
    EXPECT_EQ(spoilt("\"edited\":false", "\"edited\":1"),
              "here: edited: expected true or false, found 1");
    EXPECT_EQ(spoilt("\"top\":\"/home/me/he\"", "\"top\":7"),
              "here: worn: top: expected at most 4096 bytes of text, found 7");
    std::string former = good;  // as sessions were before
    for (const std::string& later : {std::string("\"overrides\":true"),
                                     std::string("\"edited\":false"), std::string("\"worn\":{")})
        former.replace(former.find(later) + 1, 1, "_");
    const Session before = readSessionText(former, "here");
    EXPECT_EQ(before.take.layer, (Layer{3, Layer::Blend::Add}));
    EXPECT_TRUE(before.edited);
    EXPECT_TRUE(before.worn.empty());
    EXPECT_EQ(spoilt("\"avatar\":\"", "\"avatar\":7,\"a\":\""),
              "here: avatar: expected at most 4096 bytes of text, found 7");
    const std::string deep = std::string(1'000'000, '[') + std::string(1'000'000, ']');
    EXPECT_EQ(messageOf<InputError>([&] { readSessionText(deep, "here"); }),
              "here: expected JSON nested at most 8 deep, found more at byte 8");
    EXPECT_TRUE(spoilt("\"frames\":\"0:50\"", "\"frames\":" + deep)
                    .starts_with("here: expected JSON nested at most 8 deep, found more"));
    // Cut anywhere it is refused and nothing else happens.
    for (size_t length = 0; length < good.size(); length += 7)
        EXPECT_THROW(readSessionText(good.substr(0, length), "here"), InputError) << length;
}

TEST(Recovery, RemovesWhatKilledViewersLeftHalfWritten) {
    Folder folder;
    fs::create_directories(folder / "sessions");
    for (const char* name : {"view-1-1.json", "view-1-1.lock", "view-2-2.lock",
                             ".view-3-3.doppel-tmp-0.json", "notes.txt", ".notes.json"})
        folder.write(std::string("sessions/") + name, "{}");
    AtomicFile living(folder / "sessions/view-4-4.json");
    FileLock held;
    ASSERT_TRUE(held.take(folder / "sessions/view-4-4.lock"));
    const Recovery recovery(folder.path());
    EXPECT_EQ(namesIn(folder / "sessions"),
              (std::set<std::string>{"view-1-1.json", "view-1-1.lock", "view-4-4.lock",
                                     ".view-4-4.doppel-tmp-0.json", "notes.txt", ".notes.json"}));
    living.commit();
}

TEST(Recovery, KnowsWhetherItKeepsATextOfTheSession) {
    Folder folder;
    Recovery recovery(folder.path());
    EXPECT_FALSE(recovery.kept());
    folder.write("sessions", "a file in the way");
    EXPECT_THROW(recovery.write("one"), InputError);
    EXPECT_FALSE(recovery.kept());
    fs::remove(folder / "sessions");
    recovery.write("two");
    EXPECT_TRUE(recovery.kept());
    EXPECT_EQ(bytesOf(recovery.file()), "two");
    EXPECT_TRUE(Recovery(folder.path()).orphans().empty()) << "it is held";
    // Somebody tidies up.
    fs::remove_all(folder / "sessions");
    recovery.write("three");
    EXPECT_EQ(bytesOf(recovery.file()), "three");
    EXPECT_TRUE(Recovery(folder.path()).orphans().empty()) << "it is held again";
    recovery.clear();
    EXPECT_FALSE(recovery.kept());
    EXPECT_TRUE(namesIn(folder / "sessions").empty());
}

}  // namespace
}  // namespace doppel
