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

#include "trainer/motion/skeleton_motion.h"

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

    // frame −1: the rest pose, without any channel.
    using Placement = SkeletonMotion::Placement;
    Placement place(int64_t frame) const;
};

// InputErrors name file and line, what was expected and what was found. Sizes are checked before
// memory is taken for them.
Bvh readBvh(const std::filesystem::path& file);
Bvh bvhFromText(std::string_view text, const std::string& file);

// The motion on SMPL's joints: see motionFromSkeleton.
Motion motionFromBvh(const Bvh& bvh);

}  // namespace doppel
