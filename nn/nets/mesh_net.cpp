#include "nn/nets/mesh_net.h"

#include <algorithm>

#include "nn/core/initialise.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/linalg.h"

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

int MeshNet::reach() const {
    size_t edges = 0;
    for (const Block& block : blocks_) edges += 1 + block.layers.size();  // normals, layers
    return static_cast<int>(edges);
}

bool MeshNet::takesRows() const {
    return std::ranges::all_of(blocks_, [&](const Block& block) {
        return std::ranges::all_of(block.layers, [&](const GraphConvWeights& layer) {
            return graphConvTakesRows(graph_.device(), layer);
        });
    });
}

std::vector<Tensor> MeshNet::refine(const Tensor& verts) const { return refine(verts, nullptr); }

std::vector<Tensor> MeshNet::refine(const Tensor& verts, const MovedRows& rows) const {
    return refine(verts, &rows);
}

std::vector<Tensor> MeshNet::refine(const Tensor& verts, const MovedRows* moved) const {
    std::vector<Tensor> meshes;
    Tensor now = verts, features;  // features [V,row], the normals of the block before behind
    int edges = 0;
    auto rows = [&] { return moved ? moved->within(edges) : ListedRows(); };
    for (const Block& block : blocks_) {
        ++edges;
        Tensor normals = vertexNormals(graph_, now, mesh_, rows());
        features = withTail(graph_, features, features ? hidden_ : 0, normals, rows());
        for (const GraphConvWeights& layer : block.layers) {
            ++edges;
            features = graphConvLayer(graph_, features, mesh_.adjacency, layer, normals, rows());
        }
        Tensor offset =
            tanh(graph_, linear(graph_, features, block.offsetWeight, block.offsetBias, rows()));
        now = offsetClamp(graph_, now, offset, limit_, rows());
        meshes.push_back(now);
    }
    return meshes;
}

}  // namespace doppel
