// The nodes of a glTF 2.0 file (*.glb, *.gltf, *.vrm, *.vrma) and how they move, without meshes
// and pictures.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace doppel {

struct GltfNode {
    std::string name;
    int parent = -1;  // less than the node's own number; −1: of the scene
    std::array<double, 3> translation{};
    std::array<double, 4> rotation{0, 0, 0, 1};  // x y z w, of length 1
    std::array<double, 3> scale{1, 1, 1};
};

struct GltfChannel {
    enum class Path : uint8_t { Translation, Rotation, Scale };
    enum class Between : uint8_t { Step, Linear, Cubic };
    size_t node = 0;
    Path path = Path::Rotation;
    Between between = Between::Linear;
    std::vector<double> times;   // [K], seconds, rising
    std::vector<double> values;  // [K][3 or 4]; Cubic: [K][3][3 or 4], tangents about each value

    // The value at a time, [3 or 4]; rotations are of length 1.
    std::array<double, 4> at(double time) const;
};

struct GltfNodes {
    std::vector<GltfNode> nodes;
    struct Clip {
        std::string name;
        std::vector<GltfChannel> channels;
    };
    std::vector<Clip> clips;
    // VRM's bones ("leftUpperLeg"), of versions 0 and 1 and of VRM animations.
    std::map<std::string, size_t> humanoid;
    // Of the first skin: the nodes, and their inverse bind matrices by columns.
    std::vector<size_t> joints;
    std::vector<std::array<double, 16>> inverseBind;
};

// Other files that it names have to lie in its own folder or below. InputError that names the file:
// cut short, indices and sizes that do not fit, numbers that are not finite, nodes in circles.
GltfNodes readGltfNodes(const std::filesystem::path& path);

}  // namespace doppel
