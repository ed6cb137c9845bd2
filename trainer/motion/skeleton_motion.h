// Motions of whatever skeleton of a person, brought onto SMPL's joints.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <string>
#include <vector>

#include "nn/body/joint.h"
#include "trainer/motion/motion.h"

namespace doppel {

struct SkeletonMotion {
    struct Joint {
        std::string name;  // empty: where a bone ends
        int parent = -1;   // less than the joint's own number; −1 for the first one
    };
    // Each joint's frame and place in the world.
    struct Placement {
        std::vector<glm::dquat> rotation;
        std::vector<glm::dvec3> position;
    };

    std::string file;  // for errors
    std::string rest;  // what makes the rest pose, for errors: "OFFSET"
    std::vector<Joint> joints;
    size_t frames = 0;
    double frameTime = 0;                            // seconds
    double metres = 0;                               // in a unit; 0: the format does not say
    std::function<Placement(int64_t frame)> placed;  // frame −1: the rest pose
};

// The motion on SMPL's joints, in the source's own world: poses without cameras, most often with y
// up.
//
// Joints are found by the names that CMU's files, Mixamo, Biovision, Poser, 3ds Max, Unreal,
// Rokoko, Xsens, SOMA, MakeHuman, VRM and SMPL's programs give them; left and right hips, knees,
// shoulders and elbows have to be there. The rest pose may be any standing one (T, A, arms down)
// that looks along an axis; where the source's makes no such pose, the frame that is stretched most
// stands in for it. Limbs are turned so that each bone points where the source's does. As many
// spine joints as the source has become SMPL's three. The legs' lengths give the scale, whatever
// the unit: the hips move as far as legs of the default body's length carry them. What the bones
// tell of who moved is the motion's `skeleton`.
Motion motionFromSkeleton(const SkeletonMotion& source);

// Where the joints of the default body are in a pose, metres.
std::array<glm::dvec3, joint::kCount> placeJoints(const Theta& theta, const Trans& trans);

}  // namespace doppel
