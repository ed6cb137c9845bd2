// Whole BVH files: their world, their rate, their layout; what is none is refused.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>

#include "engine/error.h"
#include "nn/body/body.h"
#include "nn/body/joint.h"
#include "tests/bvh_text.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/rendering.h"
#include "trainer/motion/bvh.h"
#include "trainer/motion/session.h"
#include "trainer/motion/upright.h"

namespace doppel {
namespace {

using namespace test;

TEST(Bvh, KeepsTheWorldOfTheFile) {
    // The same person standing along z, as some programs write; and looking along −z and x.
    for (const glm::dquat& world :
         {turn(90, kX), turn(180, kY), turn(90, kY), turn(-90, kY) * turn(90, kX)}) {
        std::vector<Bone> bones = person(true);
        for (Bone& bone : bones) bone.offset = world * bone.offset;
        const Angles angles = {{"LeftArm", world * turn(40, kZ) * glm::conjugate(world)},
                               {"Hips", world * turn(25, kY) * glm::conjugate(world)}};
        const Motion motion = motionOf(bvhText(bones, {angles}, {world * glm::dvec3(.1, .95, .2)}));
        const Motion upright = motionOf(bvhText(
            person(true), {{{"LeftArm", turn(40, kZ)}, {"Hips", turn(25, kY)}}}, {{.1, .95, .2}}));
        for (size_t j = 1; j < joint::kCount; ++j)
            expectRotation(motion.theta[0], j, axisAngle(upright.theta[0], j));
        expectRotation(motion.theta[0], 0, axisAngleOf(world * jointRotation(upright.theta[0], 0)));
        const glm::dvec3 pelvis(0, -.223, .028);
        const auto place = [](const Trans& t) { return glm::dvec3(t[0], t[1], t[2]); };
        EXPECT_LT(glm::length(place(motion.trans[0]) + pelvis -
                              world * (place(upright.trans[0]) + pelvis)),
                  1e-5);
    }
}

TEST(Bvh, GivesASmplMotionBack) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const std::vector<double> rest = restJoints(body, std::vector<double>(10, 0.));
    const auto restOf = [&](size_t j) {
        return glm::dvec3(rest[3 * j], rest[3 * j + 1], rest[3 * j + 2]);
    };
    std::vector<Bone> bones;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const int parent = body.parents[j];
        bones.push_back({jointName(j), parent < 0 ? "" : jointName(size_t(parent)),
                         parent < 0 ? restOf(j) : restOf(j) - restOf(size_t(parent))});
    }
    std::vector<MotionFrame> session = actorSession(8, 8, 3);
    for (const MotionFrame& frame : greeting(12, 2.5f)) session.push_back(frame);
    std::vector<Angles> frames;
    std::vector<glm::dvec3> places;
    for (MotionFrame& frame : session) {
        // All joints in motion, toes and knuckles too.
        for (size_t i = 3; i < 72; ++i) frame.theta[i] += .2f * std::sin(float(i * 7 % 11));
        Angles angles;
        for (size_t j = 0; j < joint::kCount; ++j)
            angles[jointName(j)] = jointRotation(frame.theta, j);
        frames.push_back(angles);
        places.push_back(restOf(0) + glm::dvec3(frame.trans[0], frame.trans[1], frame.trans[2]));
    }
    Folder folder;
    for (const char* order : {"ZXY", "XYZ", "ZYX"}) {
        Writing writing;
        writing.order = order, writing.frameTime = "0.04";
        folder.write("smpl.BVH", bvhText(bones, frames, places, writing));
        const Motion motion = readMotion(folder / "smpl.BVH");
        EXPECT_EQ(motion.fps, 25);
        EXPECT_EQ(motion.name, "smpl");
        EXPECT_EQ(motion.source, folder / "smpl.BVH");
        ASSERT_EQ(motion.size(), session.size());
        for (size_t f = 0; f < session.size(); ++f) {
            for (size_t j = 0; j < joint::kCount; ++j)
                expectRotation(motion.theta[f], j, axisAngle(session[f].theta, j), 1e-3);
            for (size_t c = 0; c < 3; ++c)
                EXPECT_NEAR(motion.trans[f][c], session[f].trans[c], 1e-3);
        }
    }
}

TEST(Bvh, StandsUprightBeforeACamera) {
    const std::vector<Angles> frames = {{{"Hips", turn(25, kY)}}, {{"Hips", turn(40, kY)}}};
    for (const glm::dquat& world : {turn(0, kX), turn(90, kX)}) {
        std::vector<Bone> bones = person(false);
        for (Bone& bone : bones) bone.offset = world * bone.offset;
        std::vector<Angles> turned = frames;
        for (Angles& angles : turned)
            angles["Hips"] = world * angles["Hips"] * glm::conjugate(world);
        const Motion motion = motionOf(bvhText(
            bones, turned, {world * glm::dvec3(0, .95, 0), world * glm::dvec3(.5, .95, 0)}));
        // What other poses without cameras get: y is up for exports, down before a camera.
        const Motion seen = inCameraSpace(motion);
        for (size_t f = 0; f < 2; ++f) {
            const glm::dvec3 up = jointRotation(motion.theta[f], 0) * kY;
            EXPECT_GT((uprightRotation(motion) * up).y, .99);
            EXPECT_LT((jointRotation(seen.theta[f], 0) * kY).y, -.99);
            // It still looks to the side it looked to, at the camera.
            EXPECT_LT((jointRotation(seen.theta[f], 0) * kZ).z, -.7);
            for (size_t i = 3; i < 72; ++i) EXPECT_EQ(seen.theta[f][i], motion.theta[f][i]);
        }
        EXPECT_NEAR(seen.trans[1][0] - seen.trans[0][0], .5 * .7551 / .8, .02);
        EXPECT_NEAR(seen.trans[1][1] - seen.trans[0][1], 0, .02);
        // The pelvis as high above the origin as in the file: y is down now.
        EXPECT_NEAR(-(seen.trans[0][1] - .223), .9 * .7551 / .8 + .0603, 5e-3);
        EXPECT_EQ(inCameraSpace(seen).theta, seen.theta);
    }
}

TEST(Bvh, ReadsFrameTimes) {
    const auto fpsOf = [](const char* frameTime) {
        Writing writing;
        writing.frameTime = frameTime;
        return motionOf(bvhText(person(false), {{}}, {{0, 1, 0}}, writing)).fps;
    };
    EXPECT_EQ(fpsOf(".0333333"), 30);
    EXPECT_EQ(fpsOf("0.008333"), 120);
    EXPECT_EQ(fpsOf("1"), 1);
    EXPECT_NEAR(fpsOf("0.033367"), 29.97, .001);
}

TEST(Bvh, IsPatientWithLayouts) {
    // Tabs, carriage returns, a byte order mark, braces on the line of the name, colons apart,
    // exponents, plus signs, small letters, empty lines, no line at the end.
    std::string text = bvhText(person(false), {{}, {}}, {{0, 1, 0}, {0, 2, 0}});
    const Motion expected = motionOf(text);
    const auto replaceAll = [](std::string s, const std::string& from, const std::string& to) {
        for (size_t at = 0; (at = s.find(from, at)) != std::string::npos; at += to.size())
            s.replace(at, from.size(), to);
        return s;
    };
    text = replaceAll(text, "Frames: 2\n", "Frames :\t2\n");
    text = replaceAll(text, "Frame Time: 0.0333333", "frame time:+3.33333E-2");
    text = replaceAll(text, "ROOT Hips\n{", "root Hips {");
    text = replaceAll(text, "End Site", "end site");
    text = replaceAll(text, "\n", "\r\n\r\n");
    text = "\xef\xbb\xbf" + text;
    while (text.ends_with("\n") || text.ends_with("\r") || text.ends_with(" ")) text.pop_back();
    const Motion found = motionOf(text);
    EXPECT_EQ(found.theta, expected.theta);
    EXPECT_EQ(found.trans, expected.trans);
    EXPECT_EQ(found.fps, expected.fps);
}

TEST(Bvh, RefusesWhatIsNone) {
    const std::string good = bvhText(person(false), {{}, {}}, {{0, 1, 0}, {0, 1, 0}});
    const auto with = [&](const std::string& from, const std::string& to) {
        std::string text = good;
        const size_t at = text.find(from);
        EXPECT_NE(at, std::string::npos) << from;
        return text.replace(at, from.size(), to);
    };
    // The line of MOTION is the first; counted from there.
    const auto line = [&](int number) {
        const auto before =
            std::count(good.begin(), good.begin() + std::ptrdiff_t(good.find("MOTION")), '\n');
        return fmt::format("test.bvh: line {}", before + number);
    };
    std::string deep = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n";
    for (int i = 0; i < 100000; ++i) deep += "JOINT a\n{\nOFFSET 0 0 0\n";
    std::string many = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n";
    for (int i = 0; i < 100000; ++i) many += "JOINT a\n{\nOFFSET 0 0 0\n}\n";
    const std::vector<std::pair<std::string, std::string>> cases = {
        {"", "test.bvh: line 1: expected HIERARCHY, found the end of the file"},
        {"MOTION", "test.bvh: line 1: expected HIERARCHY, found \"MOTION\""},
        {"HIERARCHY\nJOINT a", "test.bvh: line 2: expected ROOT, found \"JOINT\""},
        {"HIERARCHY\nROOT {",
         "test.bvh: line 2: expected a joint's name of 1 to 128 bytes, "
         "found \"\""},
        {"HIERARCHY\nROOT " + std::string(1000000, 'x'),
         "test.bvh: line 2: expected a joint's name of 1 to 128 bytes, found "
         "\"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx…\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0",
         "test.bvh: line 4: expected a number of an OFFSET, "
         "found the end of the file"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 nan",
         "test.bvh: line 4: expected a number of an OFFSET, found \"nan\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 1e300",
         "test.bvh: line 4: expected a number of an OFFSET, found \"1e300\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Yrotation Wrotation",
         "test.bvh: line 5: expected a channel such as Xrotation, found \"Wrotation\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 2 Xrotation Xrotation",
         "test.bvh: line 5: expected each channel once, found Xrotation twice"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 4000000000",
         "test.bvh: line 5: expected the number of CHANNELS, found \"4000000000\""},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 7 Xrotation",
         "test.bvh: line 5: expected 0 to 6 CHANNELS, found 7"},
        {"HIERARCHY\nROOT a\n{\nCHANNELS 0\n}",
         "test.bvh: line 5: expected an OFFSET in a, found none"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n}",
         "test.bvh: line 5: expected CHANNELS, found no joint that has any"},
        {"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nROOT b",
         "test.bvh: line 5: expected JOINT within a joint, found ROOT"},
        {deep, "test.bvh: line 1538: expected joints nested at most 512 deep, found more"},
        {many, "test.bvh: line 16385: expected at most 4096 joints, found more"},
        {good.substr(0, 700),
         "test.bvh: line 36: expected OFFSET, CHANNELS, JOINT, End Site or }, "
         "found the end of the file"},
        {with("MOTION", "ROOT b"), line(1) + ": expected MOTION, found \"ROOT\""},
        {with("Frames: 2", "Frames: 0"), line(2) + ": expected Frames: 1 or more, found 0"},
        {with("Frames: 2", "Frames: two"), line(2) + ": expected Frames: a number, found \"two\""},
        {with("Frames: 2", "Frames: 3") + std::string(1000, ' '),
         line(6) + ": expected 3 frames, as Frames says, found 2"},
        {with("Frames: 2", "Frames: 1"),
         line(5) + ": expected 1 frames, as Frames says, found more: \"0\""},
        {with("Frames: 2", "Frames: 900000000"),
         line(3) + ": expected 900000000 frames of 75 numbers, found 303 bytes for them"},
        {with("Frame Time: 0.0333333", "Frame Time: 0"),
         line(3) + ": expected a Frame Time from 0.0001 to 3600 seconds, found 0"},
        {with("Frame Time: 0.0333333", "Frame Time: -1"),
         line(3) + ": expected a Frame Time from 0.0001 to 3600 seconds, found -1"},
        {with("0 1 0 0 0 0", "0 1 0 0 0 0 7"),
         line(4) + ": expected 75 numbers, one for each channel, found more"},
        {with("0 1 0 0 0 0", "0 1 0 0 0"),
         line(4) + ": expected 75 numbers, one for each channel, found 74"},
        {with("0 1 0 0 0 0", "0 1 0 0 inf 0"), line(4) + ": expected a number, found \"inf\""},
        {with("JOINT LeftUpLeg", "JOINT Tail"),
         "test.bvh: expected a person's joints, with names such as LeftUpLeg, LeftLeg, LeftArm, "
         "LeftForeArm, found none for left_hip among Hips, Spine, Spine1, Spine2, Neck, Head, "
         "LeftShoulder, LeftArm, LeftForeArm, LeftHand, LeftHandMiddle1, RightShoulder…"},
        {with("JOINT LeftLeg", "JOINT LeftHand"), ""},
    };
    for (const auto& [text, sentence] : cases) {
        const std::string found =
            messageOf<InputError>([&] { motionFromBvh(bvhFromText(text, "test.bvh")); });
        if (!sentence.empty()) {
            EXPECT_EQ(found, sentence);
        }
        EXPECT_EQ(found.find('\n'), std::string::npos);
    }

    // Rest poses that no person takes.
    std::vector<Bone> flat = person(false);
    for (Bone& bone : flat) bone.offset = glm::dvec3(0, glm::length(bone.offset), 0);
    EXPECT_NE(messageOf<InputError>([&] {
                  motionOf(bvhText(flat, {{}}, {{0, 1, 0}}));
              }).find("test.bvh: OFFSET: expected a rest pose, or any frame, in which"),
              std::string::npos);
    for (Bone& bone : flat) bone.offset = glm::dvec3(0);
    EXPECT_EQ(messageOf<InputError>([&] {
                  motionOf(bvhText(flat, {{}}, {{0, 1, 0}}));
              }),
              "test.bvh: OFFSET: expected legs of some length, found none");
    // Legs that do not hang together.
    std::vector<Bone> apart = person(false);
    for (Bone& bone : apart)
        if (bone.name == "LeftLeg") bone.parent = "RightUpLeg";
    EXPECT_EQ(messageOf<InputError>([&] {
                  motionOf(bvhText(apart, {{}}, {{0, 1, 0}}));
              }),
              "test.bvh: expected LeftLeg (for left_knee) below LeftUpLeg (for left_hip), found "
              "it elsewhere");
    Folder folder;
    EXPECT_NE(messageOf<InputError>([&] { readMotion(folder / "none.bvh"); }).find("found nothing"),
              std::string::npos);
    folder.write("poses.bvh", std::string("PK\x03\x04"));
    EXPECT_EQ(messageOf<InputError>([&] { readMotion(folder / "poses.bvh"); }),
              (folder / "poses.bvh").string() + ": line 1: expected HIERARCHY, found \"PK??\"");
}

}  // namespace
}  // namespace doppel
