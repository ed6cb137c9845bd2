#include "nn/body/mesh_topology.h"

#include <algorithm>
#include <array>
#include <limits>

namespace doppel {

namespace {

// Turns counts [n] into begins [n+1].
std::vector<int32_t> begins(const std::vector<int32_t>& counts) {
    std::vector<int32_t> begin(counts.size() + 1);
    for (size_t i = 0; i < counts.size(); ++i) begin[i + 1] = begin[i] + counts[i];
    return begin;
}

// `width` indices per row, in [0, vertexCount).
void checkVertices(std::span<const int32_t> indices, size_t width, int64_t vertexCount,
                   std::string_view where) {
    constexpr int64_t kMost = std::numeric_limits<int32_t>::max() / 16;  // lists of corners fit
    if (vertexCount > kMost || static_cast<int64_t>(indices.size()) > kMost)
        throwInput("{}: {} vertices and {} indices are too many; expected at most {}", where,
                   vertexCount, indices.size(), kMost);
    for (size_t i = 0; i < indices.size(); ++i)
        if (indices[i] < 0 || indices[i] >= vertexCount)
            throwInput("{}: row {} names vertex {}; expected 0 to {}", where, i / width, indices[i],
                       vertexCount - 1);
}

}  // namespace

Adjacency adjacency(std::span<const int32_t> edges, int64_t vertexCount, std::string_view where) {
    checkVertices(edges, 2, vertexCount, where);
    Adjacency result;
    std::vector<int32_t> counts(static_cast<size_t>(vertexCount));
    for (int32_t vertex : edges) ++counts[size_t(vertex)];
    result.begin = begins(counts);
    result.neighbours.resize(edges.size());
    std::vector<int32_t> next(result.begin.begin(), result.begin.end() - 1);
    for (size_t e = 0; e + 1 < edges.size(); e += 2)
        for (size_t end : {size_t{0}, size_t{1}})
            result.neighbours[size_t(next[size_t(edges[e + end])]++)] = edges[e + 1 - end];
    for (size_t v = 0; v < counts.size(); ++v)
        std::sort(result.neighbours.begin() + result.begin[v],
                  result.neighbours.begin() + result.begin[v + 1]);
    return result;
}

MeshTopology meshTopology(std::span<const int32_t> faces, int64_t vertexCount,
                          std::string_view where) {
    CHECK(faces.size() % 3 == 0, "faces come as [F,3]");
    checkVertices(faces, 3, vertexCount, where);
    MeshTopology mesh;
    mesh.vertexCount = vertexCount;
    mesh.faceCount = static_cast<int64_t>(faces.size() / 3);
    mesh.faces.assign(faces.begin(), faces.end());

    std::vector<int32_t> counts(static_cast<size_t>(vertexCount));
    for (int32_t vertex : faces) ++counts[size_t(vertex)];
    mesh.cornerBegin = begins(counts);
    mesh.corners.resize(faces.size() * 3);
    std::vector<int32_t> next(mesh.cornerBegin.begin(), mesh.cornerBegin.end() - 1);
    for (size_t i = 0; i < faces.size(); ++i) {
        size_t face = i / 3, corner = i % 3;
        auto slot = static_cast<size_t>(next[size_t(faces[i])]++) * 3;
        mesh.corners[slot] = static_cast<int32_t>(face);
        mesh.corners[slot + 1] = faces[3 * face + (corner + 1) % 3];
        mesh.corners[slot + 2] = faces[3 * face + (corner + 2) % 3];
    }

    // Sides of faces by edge: lower vertex, higher vertex, 2 * face + (1 where walked downwards).
    std::vector<std::array<int32_t, 3>> sides;
    sides.reserve(faces.size());
    for (size_t i = 0; i < faces.size(); ++i) {
        size_t face = i / 3;
        int32_t a = faces[i], b = faces[3 * face + (i + 1) % 3];
        if (a == b) continue;
        sides.push_back(
            {std::min(a, b), std::max(a, b), 2 * static_cast<int32_t>(face) + (a > b ? 1 : 0)});
    }
    std::ranges::sort(sides);
    auto degenerate = [&](size_t face) {
        int32_t a = faces[3 * face], b = faces[3 * face + 1], c = faces[3 * face + 2];
        return a == b || b == c || c == a;
    };
    std::vector<std::array<int32_t, 2>> pairs;  // face, the other as in pairFaces
    for (size_t first = 0, last = 0; first < sides.size(); first = last) {
        while (last < sides.size() && sides[last][0] == sides[first][0] &&
               sides[last][1] == sides[first][1])
            ++last;
        mesh.edges.insert(mesh.edges.end(), {sides[first][0], sides[first][1]});
        if (last - first > kMaxFacesPerEdge)
            throwInput("{}: the edge {}-{} belongs to {} faces; expected at most {}", where,
                       sides[first][0], sides[first][1], last - first, kMaxFacesPerEdge);
        for (size_t i = first; i < last; ++i)
            for (size_t k = first; k < last; ++k) {
                int32_t f = sides[i][2] / 2, g = sides[k][2] / 2;
                if (f == g || degenerate(size_t(f)) || degenerate(size_t(g))) continue;
                // Two faces that agree on the outside walk their edge in opposite directions.
                int32_t flipped = (sides[i][2] & 1) == (sides[k][2] & 1) ? 1 : 0;
                pairs.push_back({f, 2 * g + flipped});
            }
    }
    mesh.adjacency = adjacency(mesh.edges, vertexCount, where);

    std::ranges::sort(pairs);
    mesh.pairCount = static_cast<int64_t>(pairs.size() / 2);
    counts.assign(static_cast<size_t>(mesh.faceCount), 0);
    for (const auto& pair : pairs) {
        ++counts[size_t(pair[0])];
        mesh.pairFaces.push_back(pair[1]);
    }
    mesh.pairBegin = begins(counts);
    return mesh;
}

Tensor listConstant(Graph& graph, std::span<const int32_t> values) {
    static constexpr int32_t kZero[1] = {0};
    if (values.empty()) values = kZero;
    return graph.constant(values, {static_cast<int64_t>(values.size())});
}

AdjacencyTensors adjacencyTensors(Graph& graph, const Adjacency& adjacency) {
    return {.vertexCount = static_cast<int64_t>(adjacency.begin.size()) - 1,
            .begin = listConstant(graph, adjacency.begin),
            .neighbours = listConstant(graph, adjacency.neighbours)};
}

MeshTensors meshTensors(Graph& graph, const MeshTopology& mesh) {
    int32_t most = 0;
    const std::vector<int32_t>& begin = mesh.adjacency.begin;
    for (size_t v = 0; v + 1 < begin.size(); ++v) most = std::max(most, begin[v + 1] - begin[v]);
    return {.vertexCount = mesh.vertexCount,
            .faceCount = mesh.faceCount,
            .pairCount = mesh.pairCount,
            .mostNeighbours = most,
            .faces = listConstant(graph, mesh.faces),
            .adjacency = adjacencyTensors(graph, mesh.adjacency),
            .cornerBegin = listConstant(graph, mesh.cornerBegin),
            .corners = listConstant(graph, mesh.corners),
            .pairBegin = listConstant(graph, mesh.pairBegin),
            .pairFaces = listConstant(graph, mesh.pairFaces)};
}

}  // namespace doppel
