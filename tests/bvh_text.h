// BVH as programs write it, of skeletons that tests make up.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "trainer/data/pose.h"
#include "trainer/motion/bvh.h"

namespace doppel::test {

constexpr double kDegree = 3.14159265358979323846 / 180;

// A skeleton for a test: joints by name, parents by name, offsets, and the frames' angles by name.
struct Bone {
    std::string name, parent;
    glm::dvec3 offset;
};
using Angles = std::map<std::string, glm::dquat>;  // of one frame; missing: none

inline glm::dquat turn(double degrees, const glm::dvec3& axis) {
    return quaternionOf(degrees * kDegree * axis);
}
inline const glm::dvec3 kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);

// Degrees about the order's three axes whose product is the rotation.
inline glm::dvec3 anglesOf(const glm::dquat& q, const std::string& order) {
    const glm::dmat3 m = glm::mat3_cast(q);
    const auto at = [&](int row, int column) { return m[column][row]; };
    if (order == "ZXY")
        return glm::dvec3(std::atan2(-at(0, 1), at(1, 1)), std::asin(at(2, 1)),
                          std::atan2(-at(2, 0), at(2, 2))) /
               kDegree;
    if (order == "XYZ")
        return glm::dvec3(std::atan2(-at(1, 2), at(2, 2)), std::asin(at(0, 2)),
                          std::atan2(-at(0, 1), at(0, 0))) /
               kDegree;
    if (order == "YXZ")
        return glm::dvec3(std::atan2(at(0, 2), at(2, 2)), -std::asin(at(1, 2)),
                          std::atan2(at(1, 0), at(1, 1))) /
               kDegree;
    EXPECT_EQ(order, "ZYX");
    return glm::dvec3(std::atan2(at(1, 0), at(0, 0)), -std::asin(at(2, 0)),
                      std::atan2(at(2, 1), at(2, 2))) /
           kDegree;
}

struct Writing {
    std::string order = "ZXY", frameTime = "0.0333333";
    double unit = 1;  // of the file in those of the bones
    bool sixEverywhere = false;
};

// The first bone is the root, whose place in each frame is `places`.
inline std::string bvhText(const std::vector<Bone>& bones, const std::vector<Angles>& frames,
                           const std::vector<glm::dvec3>& places, const Writing& writing = {}) {
    std::vector<std::string> order;  // of the channels
    std::string text = "HIERARCHY\n";
    const std::function<void(const Bone&, int)> write = [&](const Bone& bone, int depth) {
        const std::string indent(size_t(depth), '\t');
        order.push_back(bone.name);
        const glm::dvec3 offset = bone.offset / writing.unit;
        text += fmt::format("{}{} {}\n{}{{\n{}\tOFFSET {:.9g} {:.9g} {:.9g}\n", indent,
                            bone.parent.empty() ? "ROOT" : "JOINT", bone.name, indent, indent,
                            offset.x, offset.y, offset.z);
        const bool six = bone.parent.empty() || writing.sixEverywhere;
        text += fmt::format("{}\tCHANNELS {}{} {}rotation {}rotation {}rotation\n", indent,
                            six ? 6 : 3, six ? " Xposition Yposition Zposition" : "",
                            writing.order[0], writing.order[1], writing.order[2]);
        bool leaf = true;
        for (const Bone& child : bones) {
            if (child.parent != bone.name) continue;
            leaf = false;
            write(child, depth + 1);
        }
        if (leaf)
            text += fmt::format("{}\tEnd Site\n{}\t{{\n{}\t\tOFFSET 0 0 0\n{}\t}}\n", indent,
                                indent, indent, indent);
        text += indent + "}\n";
    };
    write(bones[0], 0);
    text += fmt::format("MOTION\nFrames: {}\nFrame Time: {}\n", frames.size(), writing.frameTime);
    for (size_t f = 0; f < frames.size(); ++f) {
        for (const std::string& name : order) {
            const auto bone = std::find_if(bones.begin(), bones.end(),
                                           [&](const Bone& b) { return b.name == name; });
            const bool root = bone->parent.empty();
            if (root || writing.sixEverywhere) {
                const glm::dvec3 p = (root ? places[f] : bone->offset) / writing.unit;
                text += fmt::format("{:.9g} {:.9g} {:.9g} ", p.x, p.y, p.z);
            }
            const auto found = frames[f].find(name);
            const glm::dvec3 a =
                found == frames[f].end() ? glm::dvec3(0) : anglesOf(found->second, writing.order);
            text += fmt::format("{:.9g} {:.9g} {:.9g} ", a.x, a.y, a.z);
        }
        text += "\n";
    }
    return text;
}

// A simple person of metres with names as Mixamo has them, arms in a T or hanging down.
inline std::vector<Bone> person(bool armsDown) {
    std::vector<Bone> bones = {{"Hips", "", {0, .95, 0}},        {"Spine", "Hips", {0, .1, 0}},
                               {"Spine1", "Spine", {0, .12, 0}}, {"Spine2", "Spine1", {0, .12, 0}},
                               {"Neck", "Spine2", {0, .2, 0}},   {"Head", "Neck", {0, .1, 0}}};
    for (const double side : {1., -1.}) {
        const std::string s = side > 0 ? "Left" : "Right";
        const auto arm = [&](double length) {
            return armsDown ? glm::dvec3(0, -length, 0) : glm::dvec3(side * length, 0, 0);
        };
        bones.insert(bones.end(), {{s + "UpLeg", "Hips", {side * .09, -.05, 0}},
                                   {s + "Leg", s + "UpLeg", {0, -.4, 0}},
                                   {s + "Foot", s + "Leg", {0, -.4, 0}},
                                   {s + "ToeBase", s + "Foot", {0, -.06, .14}},
                                   {s + "Shoulder", "Spine2", {side * .05, .12, 0}},
                                   {s + "Arm", s + "Shoulder", {side * .12, 0, 0}},
                                   {s + "ForeArm", s + "Arm", arm(.28)},
                                   {s + "Hand", s + "ForeArm", arm(.25)},
                                   {s + "HandMiddle1", s + "Hand", arm(.09)}});
    }
    return bones;
}

inline Motion motionOf(const std::string& text) {
    Motion motion = motionFromBvh(bvhFromText(text, "test.bvh"));
    EXPECT_TRUE(motion.cameras.empty());
    EXPECT_EQ(motion.betas, Betas{});
    return motion;
}

inline glm::dvec3 axisAngle(const Theta& theta, size_t joint) {
    return axisAngleOf(jointRotation(theta, joint));
}
inline void expectRotation(const Theta& theta, size_t joint, const glm::dvec3& expected,
                           double tolerance = 1e-4) {
    const double away = glm::length(
        axisAngleOf(jointRotation(theta, joint) * glm::conjugate(quaternionOf(expected))));
    const glm::dvec3 found = axisAngle(theta, joint);
    EXPECT_LT(away, tolerance) << jointName(joint) << ": found " << found.x << " " << found.y << " "
                               << found.z << ", expected " << expected.x << " " << expected.y << " "
                               << expected.z;
}

}  // namespace doppel::test
