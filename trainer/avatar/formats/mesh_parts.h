// What an exported mesh is made of: the body, and what hangs free of it under a name of its own.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "engine/io/gltf.h"
#include "nn/body/body.h"

namespace doppel {

// Faces of the body that are one part of the file: "body", "hair", "skirt", "loose_top". One part,
// "avatar", of a body without caps.
struct MeshPart {
    std::string name;
    std::vector<size_t> faces;
};
std::vector<MeshPart> meshParts(const BodyModel& body);

// The rows [F,3] of these parts' faces, one part behind the other.
std::vector<int32_t> inPartsOrder(std::span<const int32_t> faces, std::span<const MeshPart> parts);

// Where the parts begin in a scene whose mesh was filled with faces in that order.
void markParts(GltfScene& scene, std::span<const MeshPart> parts);

}  // namespace doppel
