// Somebody in motion on a skeleton of Mixamo's names, for the tests of motions' formats.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "trainer/data/pose.h"
#include "trainer/motion/skeleton_motion.h"

namespace doppel::test {

constexpr double kDegree = 3.14159265358979323846 / 180;
inline const glm::dvec3 kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);
inline glm::dquat turn(double degrees, const glm::dvec3& axis) {
    return quaternionOf(degrees * kDegree * glm::normalize(axis));
}

struct Bone {
    std::string name;
    int parent;
    glm::dvec3 offset;            // metres, in the T-pose
    glm::dquat axes{1, 0, 0, 0};  // the bone's own frame in the T-pose
};

// Mixamo's names; each bone's own axes are turned some other way.
inline std::vector<Bone> person() {
    std::vector<Bone> bones = {{"Hips", -1, {0, .95, 0}},  {"Spine", 0, {0, .1, 0}},
                               {"Spine1", 1, {0, .12, 0}}, {"Spine2", 2, {0, .12, 0}},
                               {"Neck", 3, {0, .2, 0}},    {"Head", 4, {0, .1, 0}}};
    for (const double side : {1., -1.}) {
        const std::string s = side > 0 ? "Left" : "Right";
        const int leg = static_cast<int>(bones.size());
        bones.insert(bones.end(), {{s + "UpLeg", 0, {side * .09, -.05, 0}},
                                   {s + "Leg", leg, {0, -.4, 0}},
                                   {s + "Foot", leg + 1, {0, -.4, 0}},
                                   {s + "ToeBase", leg + 2, {0, -.06, .14}},
                                   {s + "Shoulder", 3, {side * .05, .12, 0}},
                                   {s + "Arm", leg + 4, {side * .12, 0, 0}},
                                   {s + "ForeArm", leg + 5, {side * .28, 0, 0}},
                                   {s + "Hand", leg + 6, {side * .25, 0, 0}}});
    }
    return bones;
}

using Turns = std::vector<glm::dquat>;  // of each bone, about the T-pose's axes

// A few poses with every bone turned; the first is far from a rest pose.
inline std::vector<Turns> poses(size_t bones, size_t count = 4) {
    std::vector<Turns> all;
    for (size_t f = 0; f < count; ++f) {
        all.emplace_back();
        for (size_t b = 0; b < bones; ++b)
            all.back().push_back(turn(8 + double((7 * b + 5 * f) % 30),
                                      {std::sin(double(b)), .3, std::cos(double(b + f))}));
    }
    return all;
}
inline std::vector<glm::dvec3> places(size_t count) {
    std::vector<glm::dvec3> all;
    for (size_t f = 0; f < count; ++f) all.emplace_back(.1 * double(f), .95, .2);
    return all;
}

// What the skeleton without any axes of its own gives.
inline Motion expectedOf(const std::vector<Bone>& bones, const std::vector<Turns>& frames,
                         const std::vector<glm::dvec3>& where, double fps = 30) {
    SkeletonMotion source{"test", "rest", {}, frames.size(), 1 / fps, 1, {}};
    for (const Bone& bone : bones) source.joints.push_back({bone.name, bone.parent});
    source.placed = [&](int64_t frame) {
        SkeletonMotion::Placement placed;
        for (size_t b = 0; b < bones.size(); ++b) {
            const glm::dquat own =
                frame < 0 ? glm::dquat(1, 0, 0, 0) : frames[static_cast<size_t>(frame)][b];
            if (bones[b].parent < 0) {
                placed.rotation.push_back(own);
                placed.position.push_back(frame < 0 ? bones[b].offset
                                                    : where[static_cast<size_t>(frame)]);
                continue;
            }
            const auto p = static_cast<size_t>(bones[b].parent);
            placed.position.push_back(placed.position[p] + placed.rotation[p] * bones[b].offset);
            placed.rotation.push_back(placed.rotation[p] * own);
        }
        return placed;
    };
    return motionFromSkeleton(source);
}

inline void expectSame(const Motion& found, const Motion& expected, double tolerance = 2e-4) {
    ASSERT_EQ(found.size(), expected.size());
    EXPECT_NEAR(found.fps, expected.fps, 1e-6);
    for (size_t f = 0; f < found.size(); ++f) {
        for (size_t j = 0; j < joint::kCount; ++j)
            EXPECT_LT(glm::length(axisAngleOf(jointRotation(found.theta[f], j) *
                                              glm::conjugate(jointRotation(expected.theta[f], j)))),
                      tolerance)
                << f << " " << jointName(j);
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(found.trans[f][c], expected.trans[f][c], tolerance) << f;
    }
}

}  // namespace doppel::test
