// A walk whose contacts are known: feet that are put down, stand and are lifted, by construction.
#pragma once

#include <cmath>
#include <vector>

#include "tests/files.h"
#include "trainer/motion/motion.h"
#include "trainer/motion/retarget/contacts.h"
#include "trainer/motion/retarget/ground.h"
#include "trainer/motion/retarget/limb.h"
#include "trainer/motion/synthetic.h"

namespace doppel::test {

struct Walk {
    std::vector<JointPose> poses;  // y up, the ground is y = 0; forwards is z
    std::vector<FootContacts> contacts;
    Motion motion;  // the same, y up
};

struct WalkOptions {
    size_t frames = 120;
    double fps = 30;
    double stride = .62;    // metres from one place of a foot to its next
    double period = 1.1;    // seconds
    double standing = .62;  // share of it that a foot stands
    double heelRise = 0;    // radians that a foot turns about its ball before it is lifted
    double arms = 1.2;      // radians that the arms are lowered from the T-pose
    double apart = 0;       // metres that the feet stand further apart than the hips are
    double turn = 0;        // radians a second that the walk bends to the left
};

inline BodyModel defaultBody() {
    return bodyFromNpz(readNpz(assetFolder() / "body" / "default.npz"));
}

// Feet go from place to place; legs follow by the two-bone solution that has its own test.
inline Walk walkOf(const Proportions& body, const Betas& betas, const WalkOptions& o = {}) {
    using namespace joint;
    Walk walk;
    double sole = 0;
    for (const Sole::Point& point : body.soles[0].points) sole = std::min(sole, point.place.y);
    for (size_t f = 0; f < o.frames; ++f) {
        const double time = double(f) / o.fps, speed = o.stride / o.period;
        JointPose pose;
        for (auto& turn : pose.local) turn = glm::dquat(1, 0, 0, 0);
        // A body on a circle, or straight on.
        const auto onWay = [&](double along, double side) {
            if (o.turn == 0) return glm::dvec3(side, 0, along);
            const double radius = speed / o.turn, angle = along / radius;
            return glm::dvec3(radius - (radius - side) * std::cos(angle), 0,
                              (radius - side) * std::sin(angle));
        };
        const auto heading = [&](double along) {
            return glm::angleAxis(o.turn == 0 ? 0. : along * o.turn / speed, glm::dvec3(0, 1, 0));
        };
        const double along = speed * time;
        pose.local[kPelvis] = heading(along);
        pose.pelvis = onWay(along, 0);
        pose.pelvis.y =
            -sole + body.rest[kPelvis].y - .035 + .012 * std::cos(4 * M_PI * time / o.period);
        const double swing = .35 * std::sin(2 * M_PI * time / o.period);
        for (size_t side : {0, 1}) {
            const double sign = side == 0 ? 1 : -1;
            pose.local[kLeftShoulder + side] = glm::angleAxis(sign * swing, glm::dvec3(1, 0, 0)) *
                                               glm::angleAxis(-sign * o.arms, glm::dvec3(0, 0, 1));
            pose.local[kLeftElbow + side] = glm::angleAxis(-sign * .3, glm::dvec3(0, 1, 0));
        }
        FootContacts contacts{};
        std::array<glm::dvec3, 2> ankles;
        std::array<glm::dquat, 2> turned;
        for (size_t side : {0, 1}) {
            const double phase = time / o.period + (side == 0 ? 0. : .5);
            const double step = std::floor(phase), part = phase - step;
            const double swung = std::max(0., (part - o.standing) / (1 - o.standing));
            const double eased = swung * swung * swung * (swung * (6 * swung - 15) + 10);
            // Under the hip in the middle of the stay.
            const double place = (step + eased + o.standing / 2 - (side == 0 ? 0. : .5)) * o.stride;
            const double across = body.rest[kLeftAnkle + side].x + (side == 0 ? .5 : -.5) * o.apart;
            const double rolls = o.standing > 0 ? std::max(0., part / o.standing - .7) / .3 : 0;
            const double pitch = o.heelRise * (swung > 0 ? 1 - eased : std::min(1., rolls));
            const glm::dvec3 ankle(0, body.rest[kLeftAnkle + side].y - sole, 0);
            const glm::dvec3 ball = body.soles[side].toe - body.rest[kLeftAnkle + side];
            turned[side] = heading(place) * glm::angleAxis(pitch, glm::dvec3(1, 0, 0));
            // The toes stay flat: the ball of the foot is where the foot turns.
            ankles[side] =
                onWay(place, across) + ankle + heading(place) * ball - turned[side] * ball;
            ankles[side].y += .09 * std::sin(M_PI * eased);
            contacts[2 * side] = swung == 0 && pitch < .05;
            contacts[2 * side + 1] = swung == 0;
        }
        for (size_t side : {0, 1}) {
            reach(body, legOf(side), ankles[side], pose);
            const PlacedJoints joints = placed(body, pose);
            pose.local[kLeftAnkle + side] =
                glm::conjugate(joints.turn[kLeftKnee + side]) * turned[side];
            pose.local[joint::kLeftFoot + side] =
                glm::conjugate(turned[side]) * heading(0) * glm::dquat(1, 0, 0, 0);
            // Toes as the heading has them.
            const double yaw = std::atan2((turned[side] * glm::dvec3(1, 0, 0)).z * -1,
                                          (turned[side] * glm::dvec3(1, 0, 0)).x);
            pose.local[joint::kLeftFoot + side] =
                glm::conjugate(turned[side]) * glm::angleAxis(yaw, glm::dvec3(0, 1, 0));
        }
        walk.poses.push_back(pose);
        walk.contacts.push_back(contacts);
    }
    walk.motion.source = "walk";
    walk.motion.name = "walk";
    walk.motion.fps = o.fps;
    walk.motion.betas = betas;
    walk.motion.theta.resize(o.frames);
    walk.motion.trans.resize(o.frames);
    fromGround(walk.poses, body, {}, walk.motion);
    return walk;
}

}  // namespace doppel::test
