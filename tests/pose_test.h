// A pose and a motion for the tests of what is edited.
#pragma once

#include <memory>
#include <utility>

#include "trainer/motion/motion.h"
#include "viewer/pose/pose_editor.h"

namespace doppel::test {

inline Pose bent(double angle) {
    Pose pose;
    pose.rotation[joint::kLeftElbow] = {0, -angle, 0};
    pose.trans = {angle, 0, 0};
    return pose;
}

// A body that walks along x, turns, and bends its elbow.
inline std::shared_ptr<const Motion> walk(size_t frames) {
    Motion motion;
    motion.name = "walk";
    motion.fps = 24;
    for (size_t i = 0; i < frames; ++i) {
        Pose pose = bent(.01 * static_cast<double>(i));
        pose.rotation[0] = {0, .05 * static_cast<double>(i), 0};
        motion.theta.push_back(thetaOf(pose));
        motion.trans.push_back(transOf(pose));
    }
    return std::make_shared<const Motion>(std::move(motion));
}

inline void removeKeys(PoseEditor& editor) {
    while (!editor.keyframes().empty()) editor.removeKeyframe(editor.keyframes()[0].time);
}

// The angle between a joint's rotations, radians.
inline double turnOf(const Pose& a, const Pose& b, size_t joint) {
    return glm::length(axisAngleOf(quaternionOf(a.rotation[joint]) *
                                   glm::conjugate(quaternionOf(b.rotation[joint]))));
}

}  // namespace doppel::test
