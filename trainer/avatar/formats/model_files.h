// Avatars in formats other than glTF: Wavefront's OBJ and USD.
#pragma once

#include <filesystem>
#include <vector>

#include "engine/io/gltf.h"

namespace doppel {

// Files that are written beside `out`: FILE.mtl and FILE.png of an OBJ, FILE.png of a USD. What is
// there already is replaced only where its content says that an export wrote it.
std::vector<std::filesystem::path> companionsOf(const std::filesystem::path& out);

// The mesh as it stands, its texture and a material, in FILE.obj, FILE.mtl and FILE.png. Files
// appear whole or not at all, FILE.obj last. InputError where a companion is there already that no
// export wrote: it is somebody else's.
void writeObj(const std::filesystem::path& out, const GltfScene& scene);

// The mesh with its skeleton (UsdSkel), texture (UsdPreviewSurface, as light of its own where the
// scene is unlit) and animation, in FILE.usda and FILE.png; the same about files. Metres, y up. A
// colon in a joint's name becomes an underscore, for USD's names have none.
void writeUsd(const std::filesystem::path& out, const GltfScene& scene);

}  // namespace doppel
