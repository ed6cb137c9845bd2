#include "trainer/avatar/formats/mesh_parts.h"

#include <algorithm>
#include <array>

#include "trainer/avatar/mix/worn_caps.h"

namespace doppel {

std::vector<MeshPart> meshParts(const BodyModel& body) {
    MeshPart own{body.capVertices() == 0 ? "avatar" : "body", {}};
    for (size_t f = 0; f < static_cast<size_t>(body.modelFaces); ++f) own.faces.push_back(f);
    std::vector<MeshPart> parts{std::move(own)};
    if (body.capVertices() == 0) return parts;
    constexpr std::array<std::pair<Garment, const char*>, 3> kKinds = {
        {{Garment::Hair, "hair"}, {Garment::Bottom, "skirt"}, {Garment::Top, "loose_top"}}};
    const std::vector<CapPiece> pieces = capPieces(body);
    for (const auto& [garment, name] : kKinds) {
        MeshPart part{name, {}};
        for (const CapPiece& piece : pieces)
            if (piece.garment == garment)
                part.faces.insert(part.faces.end(), piece.faces.begin(), piece.faces.end());
        if (!part.faces.empty()) parts.push_back(std::move(part));
    }
    return parts;
}

std::vector<int32_t> inPartsOrder(std::span<const int32_t> faces, std::span<const MeshPart> parts) {
    std::vector<int32_t> rows;
    for (const MeshPart& part : parts)
        for (const size_t f : part.faces)
            rows.insert(rows.end(), {faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]});
    return rows;
}

void markParts(GltfScene& scene, std::span<const MeshPart> parts) {
    scene.parts.clear();
    size_t index = 0;
    uint32_t vertex = 0;
    for (const MeshPart& part : parts) {
        scene.parts.push_back({part.name, vertex, index});
        // Vertices come in the order in which faces first have them, and parts share none.
        for (const size_t end = index + 3 * part.faces.size(); index < end; ++index)
            vertex = std::max(vertex, scene.indices[index] + 1);
    }
}

}  // namespace doppel
