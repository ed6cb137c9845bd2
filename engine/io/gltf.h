// glTF 2.0 binary files (*.glb): one skinned, textured person with optional animations, that game
// engines, Blender and browsers open.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/io/image.h"
#include "engine/io/vrm/vrm.h"

namespace doppel {

// Rest pose without rotations, as SMPL has it: a joint's frame is the model's, moved to the joint.
struct GltfJoint {
    std::string name;
    int parent = -1;                     // of an earlier joint; −1: the root, which comes first
    std::array<float, 3> position = {};  // metres, model space
};

// K keys of all J joints, interpolated linearly (rotations along the sphere).
struct GltfAnimation {
    std::string name;
    std::vector<float> times;         // [K], seconds, rising, from 0 or more
    std::vector<float> rotations;     // [K, J, 4], unit quaternions x y z w, relative to the parent
    std::vector<float> translations;  // [K, 3], metres, added to the root joint's rest position
};

// What moves the vertices by a share that players choose; it begins at 0.
struct GltfMorph {
    std::string name;
    std::vector<float> positions;  // [V, 3], metres, added to the rest pose at a share of 1
};

// A mesh of its own: the vertices and indices from these on, up to the next part's. Its triangles
// have no vertices of other parts.
struct GltfPart {
    std::string name;
    size_t firstVertex = 0, firstIndex = 0;
};

// Model space: metres, y up, facing +z. Vertices are split along the seams of the atlas: one UV
// each (fillMesh does that).
struct GltfScene {
    std::string name = "avatar";
    std::vector<float> positions;   // [V, 3], rest pose
    std::vector<float> normals;     // [V, 3]; the writer makes them unit vectors
    std::vector<float> uvs;         // [V, 2], (0, 0) at the texture's top left
    std::vector<uint16_t> joints;   // [V, 4], the joints that move a vertex
    std::vector<float> weights;     // [V, 4], ≥ 0; the writer makes them sum to 1
    std::vector<uint32_t> indices;  // [F, 3], counter-clockwise from outside
    std::vector<GltfPart> parts;    // the first one from 0, 0; none: all is one, the scene's name
    std::vector<GltfJoint> skeleton;
    Image baseColor;  // 3 or 4 channels; empty: plain white
    bool unlit =
        true;  // KHR_materials_unlit: the texture is seen as it is, whatever lights there are
    bool doubleSided = false;
    std::optional<GltfAnimation> animation;
    std::vector<GltfAnimation> furtherAnimations;  // after the first; of glTF only
    std::vector<GltfMorph> morphs;
    std::optional<GltfVrm> vrm;
};

// The body's own arrays into the scene's mesh: vertices are copied where corners of different faces
// give them different UVs, and the four largest weights are kept.
//   verts, normals [V, 3]; faces [F, 3] into verts; uvs [T, 2]; facesUv [F, 3] into uvs;
//   weights [V, J], J = joints in the skeleton. Returns for every vertex of the scene its vertex in
//   verts.
std::vector<uint32_t> fillMesh(GltfScene& scene, std::span<const float> verts,
                               std::span<const float> normals, std::span<const int32_t> faces,
                               std::span<const float> uvs, std::span<const int32_t> facesUv,
                               std::span<const float> weights, int joints);

// Appears whole or not at all (engine/files/atomic_file.h); the same scene gives the same bytes.
// InputError: the name does not end with .glb (.vrm where there is a vrm), or a value in the scene
// is not finite. Sizes that do not fit each other are our own bug (CHECK).
void writeGlb(const std::filesystem::path& path, const GltfScene& scene);

}  // namespace doppel
