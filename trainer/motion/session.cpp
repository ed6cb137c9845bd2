#include "trainer/motion/session.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>

#include "nn/body/joint.h"

namespace doppel {

namespace {

constexpr float kPi = 3.14159265358979f;

// A pose in the making: one joint's rotation at a time, about the body's axes (x left, y up, z
// out).
struct PoseBuilder {
    MotionFrame frame;

    PoseBuilder(const char* motion, float yaw, float distance) : frame{motion, {}, {}} {
        auto root = uprightOrientation(yaw);
        std::copy(root.begin(), root.end(), frame.theta.begin());
        // The pelvis is a quarter of a metre below the origin and the feet .85 m below that: this
        // puts the middle of the body on the optical axis.
        frame.trans = {0, 0.27f, distance};
    }
    void turn(int joint, glm::vec3 axisAngle) {
        for (int k = 0; k < 3; ++k) frame.theta[static_cast<size_t>(3 * joint + k)] += axisAngle[k];
    }
    // Both arms lowered from the T-pose by these angles; positive is down.
    void arms(float left, float right) {
        turn(joint::kLeftShoulder, {0, 0, -left});
        turn(joint::kRightShoulder, {0, 0, right});
    }
    void elbows(float left, float right) {  // flexion brings the hands forward
        turn(joint::kLeftElbow, {0, -left, 0});
        turn(joint::kRightElbow, {0, right, 0});
    }
    void leg(bool left, float swing, float knee) {  // swing forward, knee flexion
        turn(left ? joint::kLeftHip : joint::kRightHip, {-swing, 0, 0});
        turn(left ? joint::kLeftKnee : joint::kRightKnee, {knee, 0, 0});
    }
    void bend(float forward) {
        for (int joint : {joint::kSpine1, joint::kSpine2, joint::kSpine3})
            turn(joint, {forward / 3, 0, 0});
    }
};

}  // namespace

std::array<float, 3> uprightOrientation(float yaw, float pitch) {
    glm::quat flip = glm::angleAxis(kPi, glm::vec3(1, 0, 0));  // y up to y down, z to the camera
    glm::quat q =
        flip * glm::angleAxis(pitch, glm::vec3(1, 0, 0)) * glm::angleAxis(yaw, glm::vec3(0, 1, 0));
    if (q.w < 0) q = -q;  // glm::angle() loses the digits of angles near a full turn
    glm::vec3 axisAngle = glm::axis(q) * glm::angle(q);
    return {axisAngle.x, axisAngle.y, axisAngle.z};
}

std::vector<MotionFrame> actorSession(int turnFrames, int motionFrames, float distance) {
    std::vector<MotionFrame> frames;
    for (int i = 0; i < turnFrames; ++i) {
        float yaw = 2 * kPi * static_cast<float>(i) / static_cast<float>(turnFrames);
        PoseBuilder pose("turn", yaw, distance);
        pose.arms(0.75f, 0.75f);
        pose.leg(true, 0.03f, 0.03f);
        frames.push_back(pose.frame);
    }
    for (int i = 0; i < motionFrames; ++i) {
        float phase = 2 * kPi * static_cast<float>(i) / static_cast<float>(motionFrames);
        PoseBuilder pose("walk", phase * 0.5f, distance);
        float swing = std::sin(phase * 2);
        pose.arms(1.15f, 1.15f);
        pose.turn(joint::kLeftShoulder, {-0.35f * -swing, 0, 0});
        pose.turn(joint::kRightShoulder, {-0.35f * swing, 0, 0});
        pose.elbows(0.35f, 0.35f);
        pose.leg(true, 0.45f * swing, 0.25f + 0.35f * std::max(0.0f, -swing));
        pose.leg(false, -0.45f * swing, 0.25f + 0.35f * std::max(0.0f, swing));
        frames.push_back(pose.frame);
    }
    for (int i = 0; i < motionFrames; ++i) {
        float phase = static_cast<float>(i) / static_cast<float>(motionFrames);
        PoseBuilder pose("arms", 0.6f * std::sin(2 * kPi * phase), distance);
        float lift = 0.9f - 1.7f * std::sin(kPi * phase);
        pose.arms(lift, lift);
        pose.elbows(0.2f + 0.6f * phase, 0.2f);
        pose.turn(joint::kHead, {0, 0.4f * std::sin(2 * kPi * phase), 0});
        frames.push_back(pose.frame);
    }
    for (int i = 0; i < motionFrames; ++i) {
        float phase = static_cast<float>(i) / static_cast<float>(motionFrames);
        PoseBuilder pose("bend", 0.8f + 0.5f * phase, distance);
        float depth = std::sin(kPi * phase);
        pose.arms(1.1f - 0.5f * depth, 1.1f - 0.5f * depth);
        pose.elbows(0.3f, 0.3f);
        pose.bend(0.8f * depth);
        pose.leg(true, 0.7f * depth, 1.0f * depth);
        pose.leg(false, 0.7f * depth, 1.0f * depth);
        frames.push_back(pose.frame);
    }
    return frames;
}

std::vector<MotionFrame> oneTake(int frames, float distance) {
    std::vector<MotionFrame> result;
    // From 0 to 1 between two moments, without a jerk.
    auto eased = [](float t, float begin, float end) {
        const float x = std::clamp((t - begin) / (end - begin), 0.0f, 1.0f);
        return x * x * (3 - 2 * x);
    };
    for (int i = 0; i < frames; ++i) {
        const float t = static_cast<float>(i) / static_cast<float>(std::max(frames - 1, 1));
        const float turned = eased(t, 0.04f, 0.62f);
        PoseBuilder pose("take", 2 * kPi * turned, distance);
        // Eight steps, as long as the body turns.
        const float stepping = std::min(eased(t, 0.04f, 0.1f), 1 - eased(t, 0.56f, 0.62f));
        const float step = stepping * std::sin(2 * kPi * 4 * (t - 0.04f) / 0.58f);
        pose.leg(true, 0.1f + 0.3f * std::max(0.0f, step), 0.1f + 0.6f * std::max(0.0f, step));
        pose.leg(false, 0.1f + 0.3f * std::max(0.0f, -step), 0.1f + 0.6f * std::max(0.0f, -step));
        const float up = eased(t, 0.62f, 0.7f) - eased(t, 0.74f, 0.82f);
        const float down = eased(t, 0.82f, 0.9f) - eased(t, 0.93f, 1.0f);
        pose.arms(0.75f - 1.4f * up + 0.3f * down, 0.75f - 1.2f * up + 0.3f * down);
        pose.elbows(0.2f + 0.7f * up + 0.2f * step, 0.25f + 0.3f * up - 0.2f * step);
        pose.bend(0.7f * down);
        pose.leg(true, 0.6f * down, 0.9f * down);
        pose.leg(false, 0.6f * down, 0.9f * down);
        pose.turn(joint::kHead, {0.1f * std::sin(9 * t), 0.25f * std::sin(2 * kPi * 3 * t), 0});
        result.push_back(pose.frame);
    }
    return result;
}

std::vector<MotionFrame> greeting(int frames, float distance) {
    std::vector<MotionFrame> result;
    for (int i = 0; i < frames; ++i) {
        float t = static_cast<float>(i) / static_cast<float>(frames);
        PoseBuilder pose("greeting", 0.5f * std::sin(2 * kPi * t), distance);
        float wave = std::clamp(std::min(t / 0.15f, (0.6f - t) / 0.1f), 0.0f, 1.0f);
        float bow = t > 0.6f ? std::sin(kPi * (t - 0.6f) / 0.4f) : 0.0f;
        pose.arms(1.15f, 1.15f - 1.6f * wave);
        pose.turn(joint::kRightElbow,
                  {0, 0.2f, -wave * (1.2f + 0.45f * std::sin(2 * kPi * t * 5))});
        pose.turn(joint::kLeftElbow, {0, -0.25f, 0});
        pose.bend(0.75f * bow);
        pose.turn(joint::kNeck, {0.35f * bow, 0, 0});
        pose.turn(joint::kHead, {0, 0, 0.1f * wave});
        result.push_back(pose.frame);
    }
    return result;
}

}  // namespace doppel
