// The mesh refinement network G_m (Gomes et al., "Creating and Reenacting Controllable 3D Humans
// with Differentiable Rendering", WACV 2022): it moves the vertices of a posed body so that the
// body wears its clothes and hair.
//
// Blocks of graph convolutions. Each block looks at the normals of the mesh as the block before
// left it, and at that block's features; its layers see the normals again behind their features;
// its offsets are tanh(W [features, normals] + b), clamped per vertex. The body is in its own
// frame: no global orientation, no translation.
#pragma once

#include <string>
#include <vector>

#include "nn/body/moved_rows.h"
#include "nn/ops/mesh.h"

namespace doppel {

struct MeshNetConfig {
    int blocks = 3;
    int layers = 6;    // graph convolutions per block
    int hidden = 128;  // features per vertex; products are fastest with multiples of 16
    // Of the layers' first weights. Signals keep their size through the layers at about
    // sqrt(2 / (37 hidden)): .02 for 128 features, .04 for 32.
    float deviation = 0.01f;
};

// Declares "mesh.block<b>.layer<l>.{weight0,bias0,weight1,bias1}" and
// "mesh.block<b>.offset.{weight, bias}". A layer's weights [hidden, inputs] take the features
// first, then the normal's three numbers; a first layer has no features in block 0. Weights of
// layers are drawn from N(0, deviation), all else is zero, so that an untrained network moves
// nothing.
void addMeshNetParameters(Parameters& parameters, const MeshNetConfig& config, uint32_t seed);

class MeshNet {
public:
    // parameters: as declared by addMeshNetParameters and allocated. limit [V]: how far each block
    // may move a vertex along each axis, m (see clampBounds); 0 freezes it.
    MeshNet(Graph& graph, const Parameters& parameters, const MeshNetConfig& config,
            const MeshTensors& mesh, const Tensor& limit);

    // verts [V,3] of the posed body. The mesh after each block, the last being the result.
    // Gradients to verts and to the parameters; may be called for several bodies of one graph.
    std::vector<Tensor> refine(const Tensor& verts) const;

    // How many edges far the last mesh depends on verts.
    int reach() const;
    // Whether refine() can leave rows out: on a CPU.
    bool takesRows() const;
    // Without gradients, and for no more than rows.within(n) of what depends on verts n edges far.
    std::vector<Tensor> refine(const Tensor& verts, const MovedRows& rows) const;

private:
    struct Block {
        std::vector<GraphConvWeights> layers;
        Tensor offsetWeight, offsetBias;  // [3,row], [3]
    };

    std::vector<Tensor> refine(const Tensor& verts, const MovedRows* rows) const;

    Graph& graph_;
    MeshTensors mesh_;
    Tensor limit_;
    int64_t hidden_;
    std::vector<Block> blocks_;
};

}  // namespace doppel
