// Ops on the vertices of a mesh whose topology is fixed. Everything is gathered along lists of
// neighbours, corners and pairs (nn/body/mesh_topology.h), in their order: the same bits every run.
// Those that take rows compute these alone and keep the others (nn/core/rows.h); they have no
// gradient then.
#pragma once

#include "nn/body/mesh_topology.h"
#include "nn/core/rows.h"

namespace doppel {

// n = s / max(|s|, 1e-6 m^2), s being the sum over the faces at the vertex of their cross products
// (v1 - v0) x (v2 - v0): larger faces count for more. A vertex without faces, or whose faces cancel
// out, gets zero. verts [V,3], result [V,3]. Gradient to verts.
Tensor vertexNormals(Graph& graph, const Tensor& verts, const MeshTensors& mesh,
                     const ListedRows& rows = {});

// L_gl: mean over the vertices of |(mean of the neighbours) - v|, not squared. A vertex without
// neighbours contributes zero. verts [V,3], result []. Gradient to verts; zero where the length is.
Tensor laplacianLoss(Graph& graph, const Tensor& verts, const MeshTensors& mesh);

// L_gn: mean over the pairs of faces that share an edge of 1 - cos(n0, n1), the pair being wound
// consistently whatever the order of its corners; 0 without pairs. A pair with a face of no area
// counts 1 and has no gradient. verts [V,3], result []. Gradient to verts.
Tensor normalConsistencyLoss(Graph& graph, const Tensor& verts, const MeshTensors& mesh);

// loss = 1/V sum over the vertices of stay |x_v|^2 + smooth stiffness_v |x_v - the mean of x over
// the neighbours|^2, for offsets x [V,3], m, and stiffness [V]. Result []. Gradient to the offsets.
Tensor offsetPenalty(Graph& graph, const Tensor& offsets, const Tensor& stiffness,
                     const MeshTensors& mesh, float stay, float smooth);

// loss = sum over the faces of weight_f max(0, least - s_f)^2, s_f = (c . c0) / |c0|^2 being what
// is left of a face: c is its cross product, c0 that of the reference's face. s_f is 1 where
// nothing moved, below 0 where a face is turned over. With weights that grow with a face's area no
// sliver pulls harder than others do. verts, reference [V,3], m; weight [F]. Result []. Gradient to
// verts.
Tensor foldPenalty(Graph& graph, const Tensor& verts, const Tensor& reference, const Tensor& weight,
                   const MeshTensors& mesh, float least);

// y ~ (I + lambda L)^-1 x, L the combinatorial Laplacian of the mesh: x smoothed over about
// sqrt(lambda) edges. A symmetric positive linear map of x, by so many Chebyshev iterations; 32
// leave 5 % of the error where lambda is 10. x, result [V,3]. No gradient.
Tensor smoothSolve(Graph& graph, const Tensor& x, const MeshTensors& mesh, float lambda,
                   int iterations = 32);

// v' = v + clamp(u, -K(v), +K(v)) per component, the offsets u and the limits K of the method.
// verts [V,3], offset [V,3], limit [V]. Gradients to verts and to offset, zero where |offset| >=
// limit.
Tensor offsetClamp(Graph& graph, const Tensor& verts, const Tensor& offset, const Tensor& limit,
                   const ListedRows& rows = {});

// Of a graph convolution whose x has rows of `row` numbers, made once and used by any number of
// convolutions.
struct GraphConvWeights {
    int64_t inputs = 0, outputs = 0, row = 0;  // I, O
    int64_t halfColumns = 0;                   // H, see shaders/mesh/graph_panels.comp
    Tensor wide;    // [2H,O], of the product: [weight0, bias0, zeros, weight1, bias1, zeros]^T
    Tensor weight;  // [2O,row] for the gradients: weight0 above weight1, zeros behind
    Tensor bias;    // [2O] stands for the biases' gradient
    // weight is made when the first gradient asks for it; until then:
    Tensor weight0, weight1;        // [O,I]
    std::shared_ptr<bool> stacked;  // whether it is made
};
// From weight0, weight1 [O,I], bias0, bias1 [O], for x with rows of `row` numbers, I or more; the
// columns of x behind I are left out. Gradients to the four.
GraphConvWeights graphConvWeights(Graph& graph, const Tensor& weight0, const Tensor& bias0,
                                  const Tensor& weight1, const Tensor& bias1, int64_t row);

// y_i = weight0 x_i + bias0 + sum over the neighbours j of i of (weight1 x_j + bias1): bias1 counts
// once per neighbour. x [V,row], result [V,O]. Gradients to x and the weights.
Tensor graphConv(Graph& graph, const Tensor& x, const AdjacencyTensors& adjacency,
                 const GraphConvWeights& weights);

// A row of features with a tail of three behind it, padded to a multiple of four, which products
// read faster.
constexpr int64_t rowWithTail(int64_t features) { return (features + 3 + 3) / 4 * 4; }

// A layer of the mesh refinement, y = [ReLU(graphConv(x)), tail, zeros]: x [V,row], tail [V,3],
// result [V,rowWithTail(O)]. Gradients to x, the tail and the weights.
Tensor graphConvLayer(Graph& graph, const Tensor& x, const AdjacencyTensors& adjacency,
                      const GraphConvWeights& weights, const Tensor& tail,
                      const ListedRows& rows = {});
// Whether it can do so for rows alone: on a CPU.
bool graphConvTakesRows(const Device& device, const GraphConvWeights& weights);

// y = [the first `columns` columns of x, tail, zeros]: x [V,R], or empty where columns is 0;
// tail [V,3]; result [V,rowWithTail(columns)]. Gradients to both.
Tensor withTail(Graph& graph, const Tensor& x, int64_t columns, const Tensor& tail,
                const ListedRows& rows = {});

}  // namespace doppel
