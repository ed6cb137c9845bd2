// Cameras, and the cameras.npz that holds them.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

#include "engine/files/npz.h"
#include "trainer/data/pose.h"

namespace doppel {

// Pinhole: x right, y down, z forward; u = fx x/z + cx, v = fy y/z + cy in pixels, whose centres
// are at .5 and whose origin is the picture's top left corner.
struct Camera {
    double fx = 0, fy = 0, cx = 0, cy = 0;
    int width = 0, height = 0;  // pixels

    // u, v of a point in camera space; z has to be positive.
    std::array<double, 2> project(const std::array<double, 3>& point) const {
        return {fx * point[0] / point[2] + cx, fy * point[1] / point[2] + cy};
    }
    bool operator==(const Camera&) const = default;
};

// What a cameras.npz holds, per frame.
struct Cameras {
    std::vector<Camera> cameras;
    std::vector<RigidMotion> extrinsics;  // from the world to the camera
};

// For so many frames. InputErrors name the file and the array, what was expected and what was
// found.
Cameras readCameras(const std::filesystem::path& path, size_t frames);

// Cameras that stand in the world's origin: one for all frames where they are alike.
Npz camerasArrays(std::span<const Camera> cameras);

}  // namespace doppel
