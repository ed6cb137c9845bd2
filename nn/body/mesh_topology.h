// Who is next to whom on a triangle mesh: computed once on the host, gathered from by the mesh ops.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "nn/core/graph.h"

namespace doppel {

// Lists by row: those of row i are list[begin[i]] ... list[begin[i + 1] - 1].

// Neighbours of each vertex, ascending.
struct Adjacency {
    std::vector<int32_t> begin;       // [V+1]
    std::vector<int32_t> neighbours;  // [2E]

    std::span<const int32_t> of(size_t v) const {
        return std::span(neighbours).subspan(size_t(begin[v]), size_t(begin[v + 1] - begin[v]));
    }
};
// From edges [E,2], each undirected edge once. InputError naming `where` for a vertex that is not
// in [0, vertexCount).
Adjacency adjacency(std::span<const int32_t> edges, int64_t vertexCount, std::string_view where);

struct MeshTopology {
    int64_t vertexCount = 0, faceCount = 0;
    std::vector<int32_t> faces;  // [F,3]
    std::vector<int32_t> edges;  // [E,2] every edge of a face once, lower vertex first, ascending
    Adjacency adjacency;
    // The corners of faces at each vertex, by face: (face, next vertex, previous vertex), so that
    // the face's cross product is (next - v) x (previous - v) at each of its corners.
    std::vector<int32_t> cornerBegin;  // [V+1]
    std::vector<int32_t> corners;      // [3F,3]
    // The faces across the edges of each face: 2 * face + (1 where it is wound the other way).
    // An edge of one face has no pair; one of three faces or more gives every pair of them.
    std::vector<int32_t> pairBegin;  // [F+1]
    std::vector<int32_t> pairFaces;  // [2 * pairCount]
    int64_t pairCount = 0;
};
// InputError naming `where` for a vertex out of range, and for more than kMaxFacesPerEdge faces at
// one edge (pairs grow with their square). A face that names a vertex twice has no pairs.
MeshTopology meshTopology(std::span<const int32_t> faces, int64_t vertexCount,
                          std::string_view where);
constexpr int kMaxFacesPerEdge = 64;

// The same as constants of a graph.
struct AdjacencyTensors {
    int64_t vertexCount = 0;
    Tensor begin, neighbours;  // [V+1], [2E]
};
AdjacencyTensors adjacencyTensors(Graph& graph, const Adjacency& adjacency);

struct MeshTensors {
    int64_t vertexCount = 0, faceCount = 0, pairCount = 0;
    int64_t mostNeighbours = 0;  // of a vertex
    Tensor faces;                // [F,3]
    AdjacencyTensors adjacency;
    Tensor cornerBegin, corners;  // [V+1], [3F,3]
    Tensor pairBegin, pairFaces;  // [F+1], [2P]
};
MeshTensors meshTensors(Graph& graph, const MeshTopology& topology);

// Integers as a constant [n], or [1] holding a zero where there are none: a kernel's buffer is
// never empty.
Tensor listConstant(Graph& graph, std::span<const int32_t> values);

}  // namespace doppel
