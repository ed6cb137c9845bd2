// What retargeting knows of a body: where its joints are at rest, what it stands on, how thick it
// is.
#pragma once

#include <array>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <vector>

#include "nn/body/body.h"
#include "trainer/data/pose.h"

namespace doppel {

// The points by which a foot touches the ground, of the rest pose, metres.
struct Sole {
    glm::dvec3 heel{0};  // turns with the ankle
    glm::dvec3 toe{0};   // under the ball of the foot; turns with the joint where the toes begin
    struct Point {
        glm::dvec3 place{0};
        double toes = 0;  // share of it that turns with the toes, the rest with the ankle
    };
    std::vector<Point> points;  // all of the sole, thinned
};

// A cone with round ends, of the rest pose, that moves with one joint. Metres.
struct Capsule {
    size_t joint = 0;
    glm::dvec3 from{0}, to{0};
    double fromRadius = 0, toRadius = 0;
};

struct Proportions {
    std::array<size_t, joint::kCount> parents{};  // the pelvis's is itself
    std::array<glm::dvec3, joint::kCount> rest{};
    std::array<Sole, 2> soles;  // left, right
    // Of the trunk from the hips to the shoulders, each lying across it: a trunk is wider than
    // deep.
    std::vector<Capsule> trunk;
    Capsule head;
    std::array<Capsule, 2> thighs, shins, feet, forearms, hands;

    double legLength() const;  // hip to knee to ankle, mean of both sides
};

// The body of this shape, with its offsets where it has them.
Proportions proportionsOf(const BodyModel& body, const Betas& betas);

// The body with its joints there: limbs, trunk, head and soles go along, as thick as they were.
Proportions withJoints(Proportions body, const std::array<glm::dvec3, joint::kCount>& rest);

// A pose of joints in a space whose y points up and whose ground is y = 0.
struct JointPose {
    std::array<glm::dquat, joint::kCount> local;  // relative to the parent; the pelvis's is global
    glm::dvec3 pelvis{0};                         // where the joint is, metres
};

// Where joints are in a pose, and how they are turned.
struct PlacedJoints {
    std::array<glm::dquat, joint::kCount> turn;
    std::array<glm::dvec3, joint::kCount> place;

    // Where a point of the rest pose goes with a joint.
    glm::dvec3 at(const Proportions& body, size_t joint, const glm::dvec3& rest) const {
        return place[joint] + turn[joint] * (rest - body.rest[joint]);
    }
};
PlacedJoints placed(const Proportions& body, const JointPose& pose);

// The contact points of a foot (0 left, 1 right) in a pose: heel, toe.
std::array<glm::dvec3, 2> contactPoints(const Proportions& body, const PlacedJoints& joints,
                                        size_t foot);
// The height of the sole's lowest point, metres.
double lowestOfSole(const Proportions& body, const PlacedJoints& joints, size_t foot);

}  // namespace doppel
