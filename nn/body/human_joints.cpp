#include "nn/body/human_joints.h"

#include <array>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr glm::dvec3 kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);

}  // namespace

const JointRange& rangeOf(size_t joint) {
    // Bending forward, and backward; to either side; turning. Thoracolumbar: 80, 25; 35; 45.
    static const JointRange spine1{kY, kX, kZ, {-14, 14}, {-15, 38}, {-16, 16}, true};
    static const JointRange spine2{kY, kX, kZ, {-18, 18}, {-14, 34}, {-16, 16}, true};
    static const JointRange spine3{kY, kX, kZ, {-24, 24}, {-12, 30}, {-16, 16}, true};
    // Cervical: 45 forward, 45 back; 45; 60 to 80.
    static const JointRange neck{kY, kX, kZ, {-42, 42}, {-32, 32}, {-26, 26}, true};
    static const JointRange head{kY, kX, kZ, {-42, 42}, {-32, 28}, {-24, 24}, true};
    // Hip: flexion 120 and extension 30 about −x, abduction 45 and adduction 30 about z, rotation
    // outward 45 and inward 45.
    static const JointRange hip{kY, -kX, kZ, {-45, 60}, {-35, 130}, {-35, 60}, true};
    // Knee: flexion 135 to 150, no extension beyond straight; some rotation when bent.
    static const JointRange knee{kY, kX, kZ, {-20, 20}, {0, 152}, {-6, 6}, false};
    // Ankle: plantar flexion 50, dorsiflexion 20 (40 under the body's weight), inversion 35,
    // eversion 15 to 20, and the foot's turning in and out.
    static const JointRange ankle{kZ, kX, kY, {-35, 20}, {-40, 52}, {-20, 25}, true};
    // Toes: bending up 70, down 40.
    static const JointRange foot{kZ, kX, kY, {-10, 10}, {-75, 42}, {-12, 12}, true};
    // Shoulder girdle: forward and back 15 to 20, up 30 to 40, down 10.
    static const JointRange collar{kX, -kY, kZ, {-20, 20}, {-22, 25}, {-14, 36}, true};
    // Shoulder, from the arm stretched sideways: horizontal adduction forward 135, abduction back
    // 45; up to the vertical (abduction 180), down to it and across the body (adduction 15);
    // rotation inward 70 to 90, outward 90.
    static const JointRange shoulder{kX, -kY, kZ, {-105, 95}, {-55, 142}, {-112, 102}, true};
    // Elbow: flexion 150, no extension beyond straight; pronation and supination 80 to 90.
    static const JointRange elbow{kX, -kY, kZ, {-90, 90}, {0, 152}, {-8, 8}, false};
    // Wrist, palm down: flexion 80, extension 70, to the thumb 20, to the little finger 30.
    static const JointRange wrist{kX, -kZ, -kY, {-45, 45}, {-75, 82}, {-36, 26}, true};
    // Knuckles: flexion 90, extension 30 to 45.
    static const JointRange hand{kX, -kZ, -kY, {-12, 12}, {-40, 92}, {-20, 20}, true};
    static const std::array<const JointRange*, joint::kCount> ranges = {
        nullptr,   &hip,      &hip,   &spine1, &knee,  &knee,   &spine2, &ankle,
        &ankle,    &spine3,   &foot,  &foot,   &neck,  &collar, &collar, &head,
        &shoulder, &shoulder, &elbow, &elbow,  &wrist, &wrist,  &hand,   &hand};
    CHECK(joint > 0 && joint < joint::kCount, "joint {} has a range", joint);
    return *ranges[joint];
}

const std::array<double, joint::kCount>& jointMasses() {
    static const std::array<double, joint::kCount> shares = [] {
        struct Segment {
            size_t from, to;
            double mass, centre;  // shares of the body's mass and of the way
        };
        std::array<double, joint::kCount> sum{};
        const auto add = [&](const Segment& s) {
            sum[s.from] += s.mass * (1 - s.centre);
            sum[s.to] += s.mass * s.centre;
        };
        add({joint::kNeck, joint::kHead, .0694, 1});
        add({joint::kSpine3, joint::kNeck, .1596, .5});
        add({joint::kSpine1, joint::kSpine3, .1633, .5});
        add({joint::kPelvis, joint::kSpine1, .1117, .3});
        for (size_t side : {size_t{0}, size_t{1}}) {  // left joints come just before right ones
            add({joint::kLeftShoulder + side, joint::kLeftElbow + side, .0271, .58});
            add({joint::kLeftElbow + side, joint::kLeftWrist + side, .0162, .46});
            add({joint::kLeftWrist + side, joint::kLeftHand + side, .0061, .8});
            add({joint::kLeftHip + side, joint::kLeftKnee + side, .1416, .41});
            add({joint::kLeftKnee + side, joint::kLeftAnkle + side, .0433, .45});
            add({joint::kLeftAnkle + side, joint::kLeftFoot + side, .0137, .5});
        }
        double whole = 0;
        for (double share : sum) whole += share;
        for (double& share : sum) share /= whole;
        return sum;
    }();
    return shares;
}

}  // namespace doppel
