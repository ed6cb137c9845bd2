// Motions: poses without pictures, which drive an avatar.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/data/camera.h"
#include "trainer/data/pose.h"

namespace doppel {

// Whose shape coefficients are: those of the body that the poses are of, which captures name; or
// SMPL's (SMPL+H's first ten are the same) or SMPL-X's, whatever body the poses are put on.
enum class ShapeSpace : uint8_t { Body, Smpl, SmplX };

// Who moved, by the skeleton of the file.
struct SourceSkeleton {
    std::array<glm::dvec3, joint::kCount> rest;  // SMPL's joints in a T-pose, the motion's metres
    double size = 1;                             // of the world's metres in one of the motion's
};

struct Motion {
    std::filesystem::path source;
    std::string name;
    // What its reader took the file to mean, where that may be taken otherwise; for people.
    std::string note;
    double fps = 30;
    std::vector<Theta> theta;
    std::vector<Trans> trans;
    Betas betas{};
    ShapeSpace shape = ShapeSpace::Body;
    std::optional<SourceSkeleton> skeleton;  // where bones say more than betas
    // Per frame where the source is a capture; then theta and trans are in camera space.
    std::vector<Camera> cameras;
    // Per frame, from the world of the cameras' file to the camera that saw the frame; empty where
    // the cameras stand in the world's origin.
    std::vector<RigidMotion> views;

    size_t size() const { return theta.size(); }
    // These frames, at the rate that keeps the motion's speed.
    Motion subset(std::span<const size_t> indices) const;
};

// Of whatever format: a capture's folder, a poses.npz, a .bvh, a glTF animation, other programs'
// poses.
Motion readMotion(const std::filesystem::path& path);
// Whether a format knows the file or folder; what is wrong with it readMotion says.
bool isMotion(const std::filesystem::path& path);

// The motion seen by the cameras of a cameras.npz (one for all frames, or one per frame), into
// whose space its poses are moved; they are taken to be in that file's world.
Motion throughCameras(Motion motion, const std::filesystem::path& cameras);

// One format. It registers itself, declared as a constant of the source file that reads it:
//
//     const MotionFormat kBvh{{
//         .looks = "a .bvh",
//         .ending = ".bvh",
//         .recognises = [](const fs::path&, std::string_view begin) { ... },
//         .read = [](const fs::path& path) { return motionFromBvh(readBvh(path)); },
//     }};
class MotionFormat {
public:
    struct Declaration {
        const char* looks;        // for the error that lists what is known
        const char* ending = "";  // of its files' names, in lower case; empty: none
        // By content: begin is the first 4096 bytes of a file, empty of a folder. Asked where no
        // format has the name's ending.
        bool (*recognises)(const std::filesystem::path& path, std::string_view begin);
        // InputErrors name the file, what was expected and what was found.
        Motion (*read)(const std::filesystem::path& path);
    };
    explicit MotionFormat(const Declaration& declaration);
};

}  // namespace doppel
