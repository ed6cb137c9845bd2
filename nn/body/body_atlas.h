// A UV atlas for a body that has none, SMPL's own file for example.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace doppel {

struct Atlas {
    std::vector<float> uvs;        // [T,2] glTF's, in [0,1]
    std::vector<int32_t> uvFaces;  // [F,3]
    int chartCount = 0;
};

// Looks at each part of the body from six sides: connected faces of one part that are seen best
// from the same side become a chart, drawn as that side sees them. Charts lie beside each other
// with seams between; no two faces share a texel, save where a chart folds over itself. The head
// gets twice the texels per metre. The same input gives the same atlas.
//
// vertices [V,3], faces [F,3], part [V] (1 to 14, see BodyPart).
Atlas makeAtlas(std::span<const float> vertices, std::span<const int32_t> faces,
                std::span<const uint8_t> part);

// What is in an atlas already.
struct AtlasUse {
    std::span<const float> vertices;   // [V,3]
    std::span<const int32_t> faces;    // [F,3]
    std::span<const float> uvs;        // [T,2]
    std::span<const int32_t> uvFaces;  // [F,3]
};

// The same for a mesh beside another one, all of it at one density: its charts lie where the
// other's atlas is empty, with as many texels per metre as that has in the mean, or with fewer
// where there is less room. Nothing where that would be less than an eighth of them.
std::optional<Atlas> makeAtlasBeside(std::span<const float> vertices,
                                     std::span<const int32_t> faces, std::span<const uint8_t> part,
                                     const AtlasUse& other);

}  // namespace doppel
