#include "nn/steps/fit_step.h"

#include <algorithm>
#include <cstddef>

#include "nn/body/human_joints.h"
#include "nn/body/likely_pose.h"
#include "nn/ops/body.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/fit.h"
#include "nn/ops/loss.h"

namespace doppel {

namespace {

// Metres of translation per unit of correction: one learning rate serves radians and metres.
constexpr float kTransScale = 0.4f;
// A body that stands or walks is about so far out of balance, metres.
constexpr float kBalance = 0.1f;
// What is up is sought near the camera's own: a pitch of six degrees costs a tenth of the weight.
constexpr float kLevel = 10;
// Slope per unit of its parameter, whose rate is the shape's.
constexpr float kUpScale = .1f;

// From what a body stands on to its centre of mass, as shares of the joints.
std::vector<float> balanceShares() {
    std::vector<float> shares(jointMasses().begin(), jointMasses().end());
    for (size_t j : {joint::kLeftAnkle, joint::kRightAnkle, joint::kLeftFoot, joint::kRightFoot})
        shares[j] -= .25f;
    return shares;
}

}  // namespace

std::vector<float> jointWeights(bool coloured, bool heads) {
    std::vector<float> weights(kJointCount, 1);
    auto set = [&](std::initializer_list<size_t> joints, float weight) {
        for (size_t j : joints) weights[j] = weight;
    };
    set({joint::kSpine1, joint::kSpine2, joint::kSpine3}, coloured ? 2.0f : 4.0f);
    set({joint::kLeftCollar, joint::kRightCollar}, 2);
    set({joint::kNeck, joint::kHead}, coloured ? 4.0f : 100.0f);
    if (heads) set({joint::kNeck}, 4);
    set({joint::kLeftWrist, joint::kRightWrist}, 4);
    set({joint::kLeftFoot, joint::kRightFoot, joint::kLeftHand, joint::kRightHand}, 20);
    return weights;
}

FitStep::FitStep(Device& device, const BodyModel& body, FitStart start, const FitPreset& preset,
                 const CompileOptions& options)
    : graph(device), start_(std::move(start)) {
    graph.join(options.ranks);
    auto frames = static_cast<int64_t>(start_.poses.size()) / kPoseRow;
    corrections.add("correction", {frames, kPoseRow}, std::vector<float>(start_.poses.size()));
    corrections.allocate(device);
    shape.add("beta", {10}, {start_.betas.begin(), start_.betas.end()});
    if (preset.balance > 0) shape.add("up", {2}, std::vector<float>(2));
    shape.allocate(device);

    const int64_t size = preset.size;
    constexpr uint32_t kFrameWord = offsetof(StepParams, frame) / 4;
    Tensor table = graph.attach(corrections.section(Parameters::kValues), {frames, kPoseRow});
    Tensor given = graph.constant(std::span<const float>(start_.poses), {frames, kPoseRow});
    Tensor bends = graph.constant(std::span<const float>(startBends(start_.poses, kTransScale)),
                                  {frames, kPoseRow});
    Tensor beta = start_.fitShape ? graph.parameter(shape, "beta")
                                  : graph.constant(std::span<const float>(start_.betas), {10});
    Tensor rest = graph.constant(body.restVertices(), {body.vertexCount, 3});
    LbsModel skin = lbsModel(graph, body);
    RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
    Tensor joints =
        graph.constant(std::span<const float>(jointWeights(false, start_.heads)), {kJointCount});
    const bool likely = preset.likely > 0 || preset.limits > 0;
    Tensor angles;
    if (likely) {
        std::vector<float> numbers;
        for (const LikelyAngle& a : likelyPose())
            numbers.insert(numbers.end(), {a.mean, a.precision, a.low, a.high});
        angles = graph.constant(std::span<const float>(numbers), {kThetaSize, 4});
    }
    Tensor shares, up;
    if (preset.balance > 0) {
        shares = graph.constant(std::span<const float>(balanceShares()), {kJointCount});
        up = scaleShift(graph, graph.parameter(shape, "up"), kUpScale, 0);
    }
    PosePriorWeights weights;
    weights.pose = static_cast<float>(preset.priorTheta);
    weights.trans = static_cast<float>(preset.priorTheta);
    weights.smooth = start_.video ? static_cast<float>(preset.smoothTheta) : 0.0f;
    weights.shape = static_cast<float>(preset.priorBeta);

    for (int i = 0; i < preset.batch; ++i)
        poseSteps.push_back(graph.input({sizeof(StepParams) / 4}, ElementType::I32));
    std::vector<Tensor> rows;
    for (const Tensor& poseStep : partOf(options.ranks, poseSteps)) {
        Sample sample{graph.input(kCameraShape), graph.input({size, size}), {}};
        Tensor correction = selectRow(graph, table, poseStep, kFrameWord);
        Tensor before = selectRow(graph, table, poseStep, kFrameWord, -1);
        Tensor after = selectRow(graph, table, poseStep, kFrameWord, 1);
        Tensor bend = selectRow(graph, bends, poseStep, kFrameWord);
        graph.watch(correction);
        rows.push_back(correction);
        Pose pose = poseCorrection(graph, selectRow(graph, given, poseStep, kFrameWord), correction,
                                   kTransScale);
        PosedBody posed = lbs(graph, skin, rest, pose.theta, beta, pose.trans);
        Tensor silhouette = softSilhouette(graph, mesh, posed.verts, sample.camera, size, size);
        losses.term("iou_loss", 1, silhouetteIouLoss(graph, silhouette, sample.target));
        losses.term("prior", 1,
                    posePrior(graph, correction, before, after, bend, joints, beta, weights));
        if (likely)
            losses.term("likely", 1,
                        poseLikelihood(graph, pose.theta, angles, static_cast<float>(preset.likely),
                                       static_cast<float>(preset.limits)));
        if (preset.balance > 0)
            losses.term("balance", preset.balance,
                        balanceLoss(graph, posed.joints, shares, up, kBalance, kLevel));
        if (start_.keypoints) {
            sample.keypoints = graph.input({kJointCount, 3});
            losses.term("keypoints", preset.keypoints,
                        keypointLoss(graph, posed.joints, sample.keypoints, sample.camera,
                                     static_cast<float>(preset.size) * kKeypointScale));
        }
        samples.push_back(sample);
    }
    graph.backward(losses.sum());

    AdamWOptions optimiser = kFitOptimiser;
    auto moments = [&](Parameters::Section section) {
        return graph.attach(corrections.section(section), {frames, kPoseRow});
    };
    const std::vector<Tensor> gradients = rowGradients(graph, rows);
    for (size_t i = 0; i < poseSteps.size(); ++i)
        adamwRow(graph, table, gradients[i], moments(Parameters::kMoment1),
                 moments(Parameters::kMoment2), optimiser, poseSteps[i]);
    if (start_.fitShape || preset.balance > 0) {
        optimiser.rateScale = static_cast<float>(preset.lrBeta / preset.lrTheta);
        adamwStep(graph, shape, optimiser);
    }
    graph.step();  // is written whether the shape is fitted or not
    graph.compile(options);
}

std::vector<float> FitStep::poses() const {
    return correctedPoses(start_.poses, corrections.read(*corrections.find("correction")),
                          kTransScale);
}

std::array<float, 10> FitStep::betas() const {
    std::array<float, 10> betas = start_.betas;
    if (start_.fitShape) std::ranges::copy(shape.read(*shape.find("beta")), betas.begin());
    return betas;
}

}  // namespace doppel
