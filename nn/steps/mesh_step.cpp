#include "nn/steps/mesh_step.h"

#include <algorithm>

#include "nn/ops/elementwise.h"
#include "nn/ops/fit.h"
#include "nn/ops/loss.h"
#include "nn/ops/mesh.h"

namespace doppel {

MeshNetwork meshNetwork(Graph& graph, const BodyModel& body, const MeshNetConfig& config,
                        ClampBounds clamps, const Parameters& parameters) {
    MeshTensors mesh = meshTensors(graph, meshTopology(body.faces, body.vertexCount, body.file));
    std::vector<float> bounds = clampBounds(body, clamps);
    Tensor limit = graph.constant(std::span<const float>(bounds), {body.vertexCount});
    std::vector<float> pose(72, 1.0f), zeros(3, 0.0f);
    std::fill_n(pose.begin(), 3, 0.0f);
    return {&graph, mesh, MeshNet(graph, parameters, config, mesh, limit),
            graph.constant(std::span<const float>(pose), {72}),
            graph.constant(std::span<const float>(zeros), {3})};
}

Tensor MeshNetwork::refine(const LbsModel& skin, const Tensor& rest, const Tensor& beta,
                           const Tensor& theta, const Tensor& trans) const {
    PosedBody posed = lbs(*graph, skin, rest, multiply(*graph, theta, bodyPose), beta, origin);
    Tensor refined = net.refine(posed.verts).back();
    return rigidTransform(*graph, refined, theta.slice(0, 3),
                          posed.joints.slice(0, 1).reshaped({3}), trans);
}

Tensor MeshNetwork::refine(const LbsModel& skin, const ShapedBody& shaped, const Tensor& theta,
                           const Tensor& trans, const MovedRows* rows) const {
    auto within = [&](int edges) { return rows ? rows->within(edges) : ListedRows(); };
    PosedBody posed =
        poseBody(*graph, skin, shaped, multiply(*graph, theta, bodyPose), origin, within(0));
    Tensor refined = (rows ? net.refine(posed.verts, *rows) : net.refine(posed.verts)).back();
    return rigidTransform(*graph, refined, theta.slice(0, 3),
                          posed.joints.slice(0, 1).reshaped({3}), trans,
                          rows ? rows->placed() : ListedRows());
}

MeshStep::MeshStep(Device& device, const BodyModel& body, const std::array<float, 10>& betas,
                   const Parameters& net, const MeshStepConfig& config,
                   const CompileOptions& options)
    : graph(device) {
    MeshNetwork network = meshNetwork(graph, body, config.net, config.clamps, net);
    LbsModel skin = lbsModel(graph, body);
    Tensor rest =
        graph.constant(std::span<const float>(body.templateVertices), {body.vertexCount, 3});
    Tensor beta = graph.constant(std::span<const float>(betas), {10});
    RasterMesh faces = rasterMesh(graph, body.faces, body.vertexCount);
    float share = 1.0f / static_cast<float>(config.batch);
    for (int i = 0; i < config.batch; ++i) {
        Sample sample{graph.input(kCameraShape), graph.input({config.size, config.size}),
                      graph.input({72}), graph.input({3})};
        Tensor verts = network.refine(skin, rest, beta, sample.theta, sample.trans);
        Tensor silhouette =
            softSilhouette(graph, faces, verts, sample.camera, config.size, config.size);
        Tensor mask = config.dilateMask ? dilate3(graph, sample.target) : sample.target;
        Tensor iou = silhouetteIouLoss(graph, silhouette, mask);
        Tensor smooth = laplacianLoss(graph, verts, network.mesh);
        Tensor bend = normalConsistencyLoss(graph, verts, network.mesh);
        std::vector<WeightedTerm> terms{{iou, share * config.silhouette},
                                        {smooth, share * config.laplacian},
                                        {bend, share * config.normal}};
        if (loss) terms.push_back({loss, 1});
        loss = weightedSum(graph, terms);
        auto add = [&](Tensor& sum, const Tensor& term) {
            sum = sum ? weightedSum(graph, {{sum, 1}, {term, share}})
                      : weightedSum(graph, {{term, share}});
        };
        add(iouLoss, iou);
        add(laplacian, smooth);
        add(normal, bend);
        samples.push_back(sample);
    }
    graph.backward(loss);
    if (config.gradientClip > 0) clipGradientNorm(graph, net, config.gradientClip);
    adamwStep(graph, net, config.optimiser);
    for (const Tensor& value : {loss, iouLoss, laplacian, normal}) graph.output(value);
    graph.compile(options);
}

}  // namespace doppel
