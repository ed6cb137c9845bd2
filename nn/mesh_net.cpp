#include "nn/mesh_net.h"

#include "nn/elementwise.h"
#include "nn/initialise.h"
#include "nn/linalg.h"

namespace doppel {

namespace {


std::string layerName(int block, int layer) {
    return fmt::format("mesh.block{}.layer{}.", block, layer);
}
std::string offsetName(int block) { return fmt::format("mesh.block{}.offset.", block); }

int64_t inputsOf(const MeshNetConfig& config, int block, int layer) {
    return block == 0 && layer == 0 ? 3 : config.hidden + 3;
}

}  // namespace

void addMeshNetParameters(Parameters& parameters, const MeshNetConfig& config, uint32_t seed) {
    int64_t O = config.hidden;
    for (int b = 0; b < config.blocks; ++b) {
        for (int l = 0; l < config.layers; ++l) {
            int64_t I = inputsOf(config, b, l);
            for (const char* which : {"0", "1"}) {
                std::string weight = layerName(b, l) + "weight" + which;
                parameters.add(weight, {O, I},
                               normalValues(seed, weight, O * I, 0, config.deviation));
                parameters.add(layerName(b, l) + "bias" + which, {O}, constantValues(O, 0));
            }
        }
        parameters.add(offsetName(b) + "weight", {3, O + 3}, constantValues(3 * (O + 3), 0));
        parameters.add(offsetName(b) + "bias", {3}, constantValues(3, 0));
    }
}

MeshNet::MeshNet(Graph& graph, const Parameters& parameters, const MeshNetConfig& config,
                 const MeshTensors& mesh, const Tensor& limit)
    : graph_(graph), mesh_(mesh), limit_(limit), hidden_(config.hidden) {
    int64_t row = rowWithTail(hidden_), padding = row - (hidden_ + 3);
    auto get = [&](const std::string& name) { return graph.parameter(parameters, name); };
    for (int b = 0; b < config.blocks; ++b) {
        Block block;
        for (int l = 0; l < config.layers; ++l) {
            std::string name = layerName(b, l);
            block.layers.push_back(graphConvWeights(
                graph, get(name + "weight0"), get(name + "bias0"), get(name + "weight1"),
                get(name + "bias1"), b == 0 && l == 0 ? rowWithTail(0) : row));
        }
        block.offsetWeight = get(offsetName(b) + "weight");
        if (padding > 0) {
            std::vector<float> zeros(static_cast<size_t>(3 * padding));
            block.offsetWeight =
                concat(graph, block.offsetWeight, graph.constant(zeros, {3, padding}), 1);
        }
        block.offsetBias = get(offsetName(b) + "bias");
        blocks_.push_back(std::move(block));
    }
}

std::vector<Tensor> MeshNet::refine(const Tensor& verts) const {
    std::vector<Tensor> meshes;
    Tensor moved = verts, features;  // features [V,row], the normals of the block before behind
    for (const Block& block : blocks_) {
        Tensor normals = vertexNormals(graph_, moved, mesh_);
        features = withTail(graph_, features, features ? hidden_ : 0, normals);
        for (const GraphConvWeights& layer : block.layers)
            features = graphConvLayer(graph_, features, mesh_.adjacency, layer, normals);
        Tensor offset =
            tanh(graph_, linear(graph_, features, block.offsetWeight, block.offsetBias));
        moved = offsetClamp(graph_, moved, offset, limit_);
        meshes.push_back(moved);
    }
    return meshes;
}

}  // namespace doppel
