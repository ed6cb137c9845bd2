// FBX files as Mixamo writes them become motions; damaged ones, and ones that a library does not
// survive, are refused.
#include <gtest/gtest.h>

#include <csignal>
#include <fstream>
#include <glm/gtx/euler_angles.hpp>
#include <random>

#include "engine/error.h"
#include "engine/files/child.h"
#include "tests/files.h"
#include "tests/moving_person.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace {

using namespace test;

// "x,y,z" in degrees, turned about x first.
std::string degrees(const glm::dquat& q) {
    double z = 0, y = 0, x = 0;
    glm::extractEulerAngleZYX(glm::mat4_cast(q), z, y, x);
    return fmt::format("{:.12f},{:.12f},{:.12f}", x / kDegree, y / kDegree, z / kDegree);
}

// FBX 7.4 as text: centimetres, y up, a bone's own axes as the rotation before its own, curves for
// each number.
std::string fbxOf(const std::vector<Bone>& bones, const std::vector<Turns>& frames,
                  const std::vector<glm::dvec3>& where, double fps) {
    constexpr double kCentimetres = 100, kTicks = 46186158000;  // of a second
    std::string objects, links;
    size_t next = 1000;
    const auto link = [&](const char* kind, size_t from, size_t to, const std::string& what = "") {
        links += fmt::format("\tC: \"{}\",{},{}{}\n", kind, from, to,
                             what.empty() ? "" : ",\"" + what + "\"");
    };
    const auto list = [](const auto& values) {
        std::string text;
        for (const auto& value : values)
            text += fmt::format("{}{}", text.empty() ? "" : ",", value);
        return text;
    };
    std::vector<std::string> times, flags;
    for (size_t f = 0; f < frames.size(); ++f)
        times.push_back(fmt::format("{}", std::llround(double(f) / fps * kTicks)));
    const size_t stack = next++, layer = next++;
    objects += fmt::format(
        "\tAnimationStack: {}, \"AnimStack::mixamo.com\", \"\" {{\n\t}}\n\tAnimationLayer: {}, "
        "\"AnimLayer::BaseLayer\", \"\" {{\n\t}}\n",
        stack, layer);
    link("OO", layer, stack);
    const auto curves = [&](size_t model, const char* letter, const char* property,
                            const std::vector<std::array<double, 3>>& values) {
        const size_t node = next++;
        objects += fmt::format(
            "\tAnimationCurveNode: {0}, \"AnimCurveNode::{1}\", \"\" {{\n\t\tProperties70:  "
            "{{\n\t\t\tP: \"d|X\", \"Number\", \"\", \"A\",{2:.9f}\n\t\t\tP: \"d|Y\", "
            "\"Number\", \"\", \"A\",{3:.9f}\n\t\t\tP: \"d|Z\", \"Number\", \"\", "
            "\"A\",{4:.9f}\n\t\t}}\n\t}}\n",
            node, letter, values[0][0], values[0][1], values[0][2]);
        link("OO", node, layer);
        link("OP", node, model, property);
        for (size_t c = 0; c < 3; ++c) {
            std::vector<std::string> numbers;
            for (const auto& value : values) numbers.push_back(fmt::format("{:.9f}", value[c]));
            const size_t curve = next++;
            objects += fmt::format(
                "\tAnimationCurve: {0}, \"AnimCurve::\", \"\" {{\n\t\tDefault: 0\n\t\tKeyVer: "
                "4008\n\t\tKeyTime: *{1} {{\n\t\t\ta: {2}\n\t\t}}\n\t\tKeyValueFloat: *{1} "
                "{{\n\t\t\ta: {3}\n\t\t}}\n\t\tKeyAttrFlags: *1 {{\n\t\t\ta: "
                "24836\n\t\t}}\n\t\tKeyAttrDataFloat: *4 {{\n\t\t\ta: "
                "0,0,255790911,0\n\t\t}}\n\t\tKeyAttrRefCount: *1 {{\n\t\t\ta: "
                "{1}\n\t\t}}\n\t}}\n",
                curve, values.size(), list(times), list(numbers));
            link("OP", curve, node, std::string("d|") + "XYZ"[c]);
        }
    };
    std::vector<size_t> models;
    for (size_t b = 0; b < bones.size(); ++b) {
        const int parent = bones[b].parent;
        const glm::dquat above = parent < 0 ? glm::dquat(1, 0, 0, 0) : bones[size_t(parent)].axes;
        const glm::dquat before = glm::conjugate(above) * bones[b].axes;
        const glm::dvec3 at = glm::conjugate(above) * bones[b].offset * kCentimetres;
        const size_t model = next++;
        models.push_back(model);
        objects += fmt::format(
            "\tModel: {}, \"Model::mixamorig:{}\", \"LimbNode\" {{\n\t\tVersion: "
            "232\n\t\tProperties70:  {{\n\t\t\tP: \"RotationActive\", \"bool\", \"\", "
            "\"\",1\n\t\t\tP: \"PreRotation\", \"Vector3D\", \"Vector\", \"\",{}\n\t\t\tP: \"Lcl "
            "Translation\", \"Lcl Translation\", \"\", \"A\",{:.9f},{:.9f},{:.9f}\n\t\t}}\n\t}}\n",
            model, bones[b].name, degrees(before), at.x, at.y, at.z);
        link("OO", model, parent < 0 ? 0 : models[size_t(parent)]);
        std::vector<std::array<double, 3>> turns, moves;
        for (size_t f = 0; f < frames.size(); ++f) {
            const glm::dquat own = glm::conjugate(bones[b].axes) * frames[f][b] * bones[b].axes;
            double z = 0, y = 0, x = 0;
            glm::extractEulerAngleZYX(glm::mat4_cast(own), z, y, x);
            turns.push_back({x / kDegree, y / kDegree, z / kDegree});
            const glm::dvec3 move = where[f] * kCentimetres;
            moves.push_back({move.x, move.y, move.z});
        }
        curves(model, "R", "Lcl Rotation", turns);
        if (parent < 0) curves(model, "T", "Lcl Translation", moves);
    }
    return fmt::format(
        "; FBX 7.4.0 project file\nFBXHeaderExtension:  {{\n\tFBXHeaderVersion: "
        "1003\n\tFBXVersion: 7400\n}}\nGlobalSettings:  {{\n\tVersion: 1000\n\tProperties70:  "
        "{{\n\t\tP: \"UpAxis\", \"int\", \"Integer\", \"\",1\n\t\tP: \"UpAxisSign\", \"int\", "
        "\"Integer\", \"\",1\n\t\tP: \"UnitScaleFactor\", \"double\", \"Number\", "
        "\"\",1\n\t}}\n}}\nObjects:  {{\n{}}}\nConnections:  {{\n{}}}\n",
        objects, links);
}

std::vector<Bone> ownAxes(std::vector<Bone> bones) {
    for (size_t b = 0; b < bones.size(); ++b)
        bones[b].axes = turn(31 * double(b), {1, double(b % 3), -.5});
    return bones;
}

TEST(Fbx, AsMixamoWritesIt) {
    Folder folder;
    const auto bones = ownAxes(person());
    const auto frames = poses(bones.size());
    const auto where = places(frames.size());
    folder.write("dance.fbx", fbxOf(bones, frames, where, 30));
    const Motion found = readMotion(folder / "dance.fbx");
    expectSame(found, expectedOf(bones, frames, where, 30), 1e-3);
    EXPECT_EQ(found.name, "mixamo.com");
    EXPECT_EQ(found.note, "a T-pose as the rest pose, 0.00943 metres to the unit");
    // Told by its content.
    folder.write("dance", fbxOf(bones, frames, where, 30));
    EXPECT_EQ(readMotion(folder / "dance").size(), frames.size());
}

TEST(Fbx, DamagedOnesAreRefused) {
    Folder folder;
    const auto bones = person();
    const auto frames = poses(bones.size());
    const std::string whole = fbxOf(bones, frames, places(frames.size()), 30);
    const auto refused = [&](const std::string& bytes) {
        folder.write("damaged.fbx", bytes);
        const std::string name = (folder / "damaged.fbx").string();
        try {
            readMotion(name);
            return false;
        } catch (const InputError& error) {
            EXPECT_TRUE(std::string_view(error.what()).starts_with(name)) << error.what();
            return true;
        }
    };
    EXPECT_TRUE(refused("no FBX at all"));
    EXPECT_TRUE(refused("Kaydara FBX Binary  "));
    for (const size_t part : {2, 3, 10}) EXPECT_TRUE(refused(whole.substr(0, whole.size() / part)));
    std::mt19937 random(1);
    int refusals = 0;
    for (int i = 0; i < 24; ++i) {
        std::string damaged = whole;
        for (int k = 0; k < 30; ++k)
            damaged[random() % (i % 2 ? damaged.size() : 4000)] = char(random());
        refusals += refused(damaged);
    }
    EXPECT_GT(refusals, 6);
}

// ---- the child that reads -----------------------------------------------------------------------

TEST(Child, ReturnsBytesAndErrors) {
    const std::vector<uint8_t> many(size_t{3} << 20, 7);
    EXPECT_EQ(inChild("a.bin", "a file", [&] { return many; }), many);
    EXPECT_EQ(inChild("a.bin", "a file", [] { return std::vector<uint8_t>(); }),
              std::vector<uint8_t>());
    EXPECT_EQ(messageOf<InputError>([] {
                  inChild("a.bin", "a file", []() -> std::vector<uint8_t> {
                      throw InputError("a.bin: it is damaged");
                  });
              }),
              "a.bin: it is damaged");
}

TEST(Child, MayDie) {
    const char* kDead = "a.bin: expected a file, found one that its reader does not survive";
    const auto with = [](const std::function<void()>& work) {
        return messageOf<InputError>([&] {
            inChild("a.bin", "a file", [&] {
                work();
                return std::vector<uint8_t>();
            });
        });
    };
    EXPECT_EQ(with([] { std::raise(SIGKILL); }), kDead);
    EXPECT_EQ(with([] { std::_Exit(3); }), kDead);
    EXPECT_EQ(with([] { throw std::bad_alloc(); }), kDead);
}

}  // namespace
}  // namespace doppel
