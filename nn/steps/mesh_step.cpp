#include "nn/steps/mesh_step.h"

#include <algorithm>
#include <cmath>

#include "nn/ops/elementwise.h"
#include "nn/ops/loss.h"
#include "nn/ops/mesh.h"
#include "nn/ops/surface.h"
#include "nn/steps/light.h"

namespace doppel {

// Difference of colours from which on outliers count less.
constexpr float kRobust = 0.02f;

MeshNetConfig meshNetConfig(const MeshPreset& preset) {
    return {.blocks = preset.blocks,
            .layers = preset.layers,
            .hidden = preset.hidden,
            .deviation = static_cast<float>(preset.deviation)};
}

MeshNetwork meshNetwork(Graph& graph, const BodyModel& body, const MeshNetConfig& config,
                        ClampBounds clamps, const Parameters& parameters) {
    MeshTensors mesh = meshTensors(graph, meshTopology(body.faces, body.vertexCount, body.file));
    std::vector<float> bounds = clampBounds(body, clamps);
    Tensor limit = graph.constant(std::span<const float>(bounds), {body.vertexCount});
    std::vector<float> pose(kThetaSize, 1.0f), zeros(3, 0.0f);
    std::fill_n(pose.begin(), 3, 0.0f);
    return {&graph, mesh, MeshNet(graph, parameters, config, mesh, limit),
            graph.constant(std::span<const float>(pose), {kThetaSize}),
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
                   const Parameters& net, const MeshPreset& preset, const CompileOptions& options,
                   std::span<const float> texels, std::span<const float> light)
    : graph(device) {
    graph.join(options.ranks);
    MeshNetwork network = meshNetwork(graph, body, meshNetConfig(preset), preset.clamps, net);
    LbsModel skin = lbsModel(graph, body);
    Tensor rest = graph.constant(body.restVertices(), {body.vertexCount, 3});
    Tensor beta = graph.constant(std::span<const float>(betas), {10});
    RasterMesh faces = rasterMesh(graph, body.faces, body.vertexCount);
    const int64_t size = preset.size;
    const bool edges = preset.loss == SilhouetteLoss::Edges;
    const bool bounded = preset.stay > 0 || preset.smooth > 0;
    const bool coloured = edges && preset.colour > 0 && !texels.empty();
    SurfaceLook look;
    Tensor albedo;
    std::optional<CaptureLight> lights;
    Tensor stiffness;
    if (bounded)
        stiffness = graph.constant(surfaceStiffness(body, preset.hands, 1), {body.vertexCount});
    if (coloured) {
        const auto side = static_cast<int64_t>(std::lround(std::sqrt(texels.size() / 3)));
        Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
        look.atlas = rasterAtlas(graph, uvs, body.uvFaces);
        albedo = graph.constant(texels, {side, side, 3});
        lights.emplace(graph, body, faces, side, light);
    }
    for (int i = 0; i < preset.batch / sizeOf(options.ranks); ++i) {
        Sample sample{graph.input(kCameraShape),
                      graph.input({preset.size, preset.size}),
                      graph.input({kThetaSize}),
                      graph.input({3}),
                      {},
                      {},
                      {}};
        Tensor verts = network.refine(skin, rest, beta, sample.theta, sample.trans);
        Tensor mask = preset.dilateMask ? dilate3(graph, sample.target) : sample.target;
        // L_m = L_s + λ_gl L_gl + λ_gn L_gn
        if (!edges) {
            Tensor silhouette =
                softSilhouette(graph, faces, verts, sample.camera, preset.size, preset.size);
            losses.term("iou_loss", preset.silhouette, silhouetteIouLoss(graph, silhouette, mask));
        } else {
            sample.scale = graph.input({1});
            sample.counts = graph.input({size, size});
            if (coloured) {
                sample.image = graph.input({size, size, 3});
                sample.background = graph.input({size, size, 3});
                look.background = sample.background;
                look.texture = lights->lit(albedo, verts);
            }
            SurfaceRender drawn = surfaceRender(graph, faces, verts, sample.camera,
                                                coloured ? &look : nullptr, size, size);
            losses.term("edges", preset.silhouette,
                        pyramidLoss(graph, drawn.alpha, mask, sample.counts, sample.scale,
                                    {.cell1 = 2, .cell2 = 1, .cell4 = .5f, .cell8 = .25f}));
            if (coloured)  // the mean of the channels
                losses.term(
                    "colour", preset.colour / 3,
                    pyramidLoss(graph, drawn.image, sample.image, sample.counts, sample.scale,
                                {.cell1 = 1, .cell2 = .5f, .cell4 = .5f}, kRobust));
        }
        if (bounded) {
            Tensor posed = lbs(graph, skin, rest, sample.theta, beta, sample.trans).verts;
            losses.term("offsets", 1,
                        offsetPenalty(graph, add(graph, verts, scaleShift(graph, posed, -1, 0)),
                                      stiffness, network.mesh, static_cast<float>(preset.stay),
                                      static_cast<float>(preset.smooth)));
        }
        if (preset.laplacian > 0)
            losses.term("laplacian", preset.laplacian, laplacianLoss(graph, verts, network.mesh));
        if (preset.normal > 0)
            losses.term("normal", preset.normal, normalConsistencyLoss(graph, verts, network.mesh));
        samples.push_back(sample);
    }
    graph.backward(losses.sum());
    if (preset.gradientClip > 0)
        clipGradientNorm(graph, net, static_cast<float>(preset.gradientClip));
    adamwStep(graph, net, adamwOptions(preset));
    graph.compile(options);
}

}  // namespace doppel
