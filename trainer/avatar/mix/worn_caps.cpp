#include "trainer/avatar/mix/worn_caps.h"

#include <algorithm>
#include <glm/glm.hpp>
#include <map>

#include "engine/error.h"
#include "nn/body/body_caps.h"
#include "nn/body/mesh_topology.h"
#include "nn/body/texel_places.h"
#include "trainer/avatar/bake.h"

namespace doppel {

namespace {

// [V] Places of a shape at rest, without and with what the person has beyond the model.
std::vector<glm::dvec3> places(const BodyModel& body, const Betas& betas, bool offsets) {
    BodyModel plain = body;
    if (!offsets) plain.offsets.clear();
    const std::vector<double> verts =
        shapedVertices(plain, std::vector<double>(betas.begin(), betas.end()));
    std::vector<glm::dvec3> all;
    for (size_t i = 0; i < verts.size(); i += 3)
        all.emplace_back(verts[i], verts[i + 1], verts[i + 2]);
    return all;
}

const std::vector<float>& textureOf(const Avatar& avatar) {
    return avatar.bakedTexture.empty() ? avatar.texture : avatar.bakedTexture;
}

}  // namespace

Avatar withoutCap(const Avatar& avatar) {
    if (avatar.body.capVertices() == 0) return avatar;
    Avatar plain = avatar;
    plain.bodyArrays = withoutCap(avatar.bodyArrays);
    plain.body = bodyFromNpz(plain.bodyArrays);
    return plain;
}

std::vector<CapPiece> capPieces(const BodyModel& body) {
    const MeshTopology mesh = meshTopology(body.faces, body.vertexCount, body.file);
    const auto V = static_cast<size_t>(body.vertexCount);
    std::vector<int> pieceOf(V, -1);
    int count = 0;
    for (auto first = static_cast<size_t>(body.modelVertices); first < V; ++first) {
        if (pieceOf[first] >= 0) continue;
        std::vector<size_t> waiting{first};
        pieceOf[first] = count;
        while (!waiting.empty()) {
            const size_t v = waiting.back();
            waiting.pop_back();
            for (auto k = mesh.adjacency.begin[v]; k < mesh.adjacency.begin[v + 1]; ++k) {
                const auto n = static_cast<size_t>(mesh.adjacency.neighbours[size_t(k)]);
                if (pieceOf[n] >= 0) continue;
                pieceOf[n] = count;
                waiting.push_back(n);
            }
        }
        ++count;
    }
    std::vector<CapPiece> pieces(static_cast<size_t>(count), {Garment::Top, {}});
    auto legs = [](uint8_t part) { return part >= kLeftThigh && part <= kRightCalf; };
    for (auto f = static_cast<size_t>(body.modelFaces); f < static_cast<size_t>(body.faceCount);
         ++f)
        pieces[size_t(pieceOf[size_t(body.faces[3 * f])])].faces.push_back(f);
    for (size_t v = static_cast<size_t>(body.modelVertices); v < V; ++v) {
        Garment& garment = pieces[size_t(pieceOf[v])].garment;
        if (body.part[v] == kHead)
            garment = Garment::Hair;
        else if (legs(body.part[v]) && garment != Garment::Hair)
            garment = Garment::Bottom;
    }
    std::erase_if(pieces, [](const CapPiece& piece) { return piece.faces.empty(); });
    return pieces;
}

bool wearCaps(Avatar& avatar, const std::vector<WornPiece>& pieces) {
    if (pieces.empty()) return true;
    CHECK(avatar.body.capVertices() == 0, "the pieces make one cap");
    const std::vector<glm::dvec3> own = places(avatar.body, avatar.betas, false);
    BodyCap cap;
    struct Source {
        const Avatar* giver;
        size_t face;
    };
    std::vector<Source> sources;  // of the cap's faces
    for (const WornPiece& worn : pieces) {
        const BodyModel& body = worn.giver->body;
        const std::vector<glm::dvec3> bare = places(body, worn.giver->betas, false),
                                      whole = places(body, worn.giver->betas, true);
        const auto model = static_cast<size_t>(body.modelVertices);
        std::map<int32_t, int32_t> numbers;  // in the cap, of the giver's vertices
        for (size_t face : worn.piece.faces)
            for (size_t k = 0; k < 3; ++k) numbers[body.faces[3 * face + k]] = 0;
        for (auto& [v, number] : numbers) {
            number = static_cast<int32_t>(cap.nearest.size());
            const glm::dvec3& p = whole[size_t(v)];
            size_t nearest = 0;
            for (size_t n = 1; n < model; ++n)
                if (glm::distance(bare[n], p) < glm::distance(bare[nearest], p)) nearest = n;
            const glm::dvec3 there = own[nearest] + (p - bare[nearest]);
            for (int axis = 0; axis < 3; ++axis)
                cap.vertices.push_back(static_cast<float>(there[axis]));
            cap.nearest.push_back(static_cast<int64_t>(nearest));
            const auto row = body.weights.begin() + int64_t{v} * BodyModel::kJoints;
            cap.weights.insert(cap.weights.end(), row, row + BodyModel::kJoints);
        }
        for (size_t face : worn.piece.faces) {
            sources.push_back({worn.giver, face});
            for (size_t k = 0; k < 3; ++k) cap.faces.push_back(numbers[body.faces[3 * face + k]]);
        }
    }
    const std::vector<float> offsets = avatar.body.offsets;
    const std::optional<Npz> arrays = withCap(avatar.bodyArrays, cap, avatar.betas);
    if (!arrays) return false;
    avatar.bodyArrays = *arrays;
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    const BodyModel& body = avatar.body;
    if (!offsets.empty()) {
        std::vector<float> all = offsets;
        all.resize(3 * static_cast<size_t>(body.vertexCount));
        setOffsets(avatar, all);
    }

    const std::vector<TexelPlace> texels = texelPlaces(body, avatar.textureSize);
    for (size_t i = 0; i < texels.size(); ++i) {
        if (texels[i].face < body.modelFaces) continue;
        const Source& source = sources[size_t(texels[i].face - body.modelFaces)];
        const BodyModel& from = source.giver->body;
        glm::dvec2 uv(0);
        for (size_t k = 0; k < 3; ++k) {
            const auto t = static_cast<size_t>(from.uvFaces[3 * source.face + k]);
            uv += double{texels[i].corners[k]} * glm::dvec2(from.uvs[2 * t], from.uvs[2 * t + 1]);
        }
        const glm::dvec3 colour = colourAt(textureOf(*source.giver), source.giver->textureSize, uv);
        for (int c = 0; c < 3; ++c) avatar.texture[3 * i + size_t(c)] = float(colour[c]);
    }
    spreadCharts(texels, avatar.textureSize, avatar.texture);
    return true;
}

}  // namespace doppel
