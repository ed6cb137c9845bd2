// The nodes of an FBX file and how they move, without meshes and pictures. By assimp.
#pragma once

#include <filesystem>

#include "engine/io/gltf_nodes.h"

namespace doppel {

// As a glTF's: what FBX has more (pivots, rotations before and after) is part of each node's own.
// The library reads in a child process (engine/files/child.h), and opens no other file. InputError
// that names the file: of another kind, more than 512 MB, more than 10,000 nodes, numbers that are
// not finite, and what assimp says.
GltfNodes readFbxNodes(const std::filesystem::path& path);

}  // namespace doppel
