// BVH, Biovision's motion files: a skeleton by joint offsets and a table of angles, in many
// dialects.
//
//     Motion motion = motionFromBvh(readBvh("dance.bvh"));
#pragma once

#include <cstddef>
#include <filesystem>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/motion/motion.h"

namespace doppel {

struct Bvh {
    enum class Channel { PositionX, PositionY, PositionZ, RotationX, RotationY, RotationZ };
    struct Joint {
        std::string name;     // "End Site" where a bone ends
        int parent = -1;      // less than the joint's own number; −1 for the first one
        glm::dvec3 offset{};  // from the parent, in the file's unit
        // A rotation is the product of its channels' from left to right. Positions take the
        // offset's place.
        std::vector<Channel> channels;
        size_t first = 0;  // of its channels in a frame
    };

    std::string file;  // for errors
    std::vector<Joint> joints;
    size_t channels = 0, frames = 0;
    double frameTime = 0;        // seconds
    std::vector<double> values;  // [frames][channels] degrees, and positions in the file's unit

    // Each joint's frame and place in the world. frame −1: the rest pose, without any channel.
    struct Placement {
        std::vector<glm::dquat> rotation;
        std::vector<glm::dvec3> position;
    };
    Placement place(int64_t frame) const;
};

// InputErrors name file and line, what was expected and what was found. Sizes are checked before
// memory is taken for them.
Bvh readBvh(const std::filesystem::path& file);
Bvh bvhFromText(std::string_view text, const std::string& file);

// The motion on SMPL's joints, in the file's own world: poses without cameras, most often with y
// up.
//
// Joints are found by the names that CMU's files, Mixamo, Biovision, Poser, 3ds Max, Unreal,
// Rokoko, Xsens and SMPL's programs give them; left and right hips, knees, shoulders and elbows
// have to be there. The rest pose may be any standing one (T, A, arms down) that looks along an
// axis; where the offsets make no such pose, the frame that is stretched most stands in for it.
// Limbs are turned so that each bone points where the source's does. As many spine joints as the
// source has become SMPL's three. The legs' lengths give the scale, whatever the unit: the hips
// move as far as legs of the default body's length carry them.
Motion motionFromBvh(const Bvh& bvh);

}  // namespace doppel
