#include "nn/steps/surface_step.h"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <optional>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "nn/body/face_views.h"
#include "nn/body/feet.h"
#include "nn/body/seams.h"
#include "nn/ops/body.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/fit.h"
#include "nn/ops/linalg.h"
#include "nn/ops/loss.h"
#include "nn/ops/mesh.h"
#include "nn/ops/texture.h"
#include "nn/steps/fit_step.h"
#include "nn/steps/light.h"

namespace doppel {

namespace {

AdamWOptions withRate(AdamWOptions options, double rate) {
    options.rateScale = static_cast<float>(rate);
    return options;
}

// What has to be left of a face, seen from where its normal pointed at the stage's start.
constexpr float kLeastFace = .25f;
// Hair and cloth grow where the paper lets vertices move, so faces turn there for good reasons; on
// face, hands and soles, where K(v) is 0, they do not.
constexpr float kMovingFaces = .3f;
// Part of a crop, in which a face is a tenth, from which on a point of the face that is seen
// elsewhere counts less.
constexpr float kFaceScale = .015f;
// Bones end where hands are clenched, or bent back (HandAmounts).
constexpr float kLeastHand = -.25f, kMostHand = 1.5f;

// Of each face [F]: its part of the area of the surface verts [V,3], times kMovingFaces but where
// K(v) holds a corner.
std::vector<float> foldWeights(const BodyModel& body, const std::vector<float>& verts) {
    const std::vector<float> bounds = clampBounds(body, ClampBounds::Paper);
    std::vector<float> weights;
    double area = 0;
    for (size_t f = 0; f < static_cast<size_t>(body.faceCount); ++f) {
        std::array<glm::dvec3, 3> corners;
        bool held = false;
        for (size_t k = 0; k < 3; ++k) {
            const auto v = static_cast<size_t>(body.faces[3 * f + k]);
            corners[k] = {verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]};
            held |= bounds[v] == 0;
        }
        const double twice =
            glm::length(glm::cross(corners[1] - corners[0], corners[2] - corners[0]));
        area += twice;
        weights.push_back(static_cast<float>(held ? twice : kMovingFaces * twice));
    }
    for (float& weight : weights) weight /= static_cast<float>(area);
    return weights;
}

}  // namespace

SurfaceState::SurfaceState(Device& device, const BodyModel& body, SurfaceStart first,
                           const SurfacePreset& preset)
    : start(std::move(first)),
      transScale(static_cast<float>(preset.lrTrans / preset.lrTheta)),
      bare(body.templateVertices) {
    const auto frames = static_cast<int64_t>(start.poses.size()) / kPoseRow;
    const int64_t V = body.vertexCount, texture = start.textureSize;
    if (start.offsets.empty()) start.offsets.resize(static_cast<size_t>(3 * V));
    corrections.add("correction", {frames, kPoseRow}, std::vector<float>(start.poses.size()));
    offsets.add("offsets", {V, 3}, start.offsets);
    if (!start.texels.empty())
        texels.add("texels", {texture, texture, 3}, std::vector<float>(start.texels.size()));
    if (!start.texels.empty() && start.movesTexels && preset.lrLight > 0) {
        if (start.light.empty()) start.light.resize(kLightNumbers);
        light.add("light", {kLightRows, 3}, start.light);
    }
    if (!start.texels.empty() && preset.lrGain > 0)
        gains.add("gains", {frames, 3}, std::vector<float>(static_cast<size_t>(3 * frames)));
    if (start.movesOffsets && preset.lrHands > 0) {
        BodyModel worn = body;
        worn.offsets = start.offsets;
        fingers = fingerRig(worn);
        if (!fingers.empty()) hands.add("hands", {4}, std::vector<float>(HandAmounts().size()));
    }
    if (start.movesOffsets && preset.toes > 0)
        toes = movedWithToes(body, start.offsets, preset.toes);
    for (Parameters* parameters : {&corrections, &offsets, &texels, &light, &gains, &hands})
        if (!parameters->entries().empty()) parameters->allocate(device);
}

SurfaceStep::SurfaceStep(Device& device, const BodyModel& body, SurfaceState& state,
                         const SurfacePreset& preset, const CompileOptions& options)
    : graph(device) {
    graph.join(options.ranks);
    const SurfaceStart& start = state.start;
    Parameters &corrections = state.corrections, &offsets = state.offsets, &texels = state.texels;
    const auto frames = static_cast<int64_t>(start.poses.size()) / kPoseRow;
    const int64_t size = preset.size, V = body.vertexCount, texture = start.textureSize;
    const bool coloured = !start.texels.empty();
    const bool movesTexels = coloured && start.movesTexels;
    const bool movesLight = !state.light.entries().empty();
    const bool movesGains = !state.gains.entries().empty();
    const bool movesHands = !state.hands.entries().empty();

    // What all frames share.
    MeshTensors mesh = meshTensors(graph, meshTopology(body.faces, V, body.file));
    LbsModel skin = lbsModel(graph, body);
    RasterMesh faces = rasterMesh(graph, body.faces, V);
    Tensor beta = graph.constant(std::span<const float>(start.betas), {10});
    Tensor own = start.movesOffsets ? graph.parameter(offsets, "offsets")
                                    : graph.constant(std::span<const float>(start.offsets), {V, 3});
    if (state.toes.rows() > 0)
        own = add(graph, sparseProduct(graph, state.toes, own),
                  graph.constant(std::span<const float>(state.unmoved()), {V, 3}));
    Tensor bare = graph.constant(std::span<const float>(body.templateVertices), {V, 3});
    const Tensor straight = add(graph, own, bare);
    Tensor rest = straight;
    if (movesHands)
        rest = bendFingers(graph, straight,
                           clamp(graph,
                                 add(graph, graph.parameter(state.hands, "hands"),
                                     graph.constant(std::span<const float>(start.hands), {4})),
                                 kLeastHand, kMostHand),
                           fingerTensors(graph, state.fingers));
    SurfaceLook look;
    if (coloured) {
        Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
        look.atlas = rasterAtlas(graph, uvs, body.uvFaces);
        look.texture = graph.constant(std::span<const float>(start.texels), {texture, texture, 3});
        if (movesTexels)
            look.texture =
                add(graph, look.texture, binomialMean(graph, graph.parameter(texels, "texels")));
    }
    const Tensor albedo = look.texture;
    // Of texels that are smaller than half a pixel, a pixel's samples meet one here and another
    // there, and pull vertices to and fro: what is drawn are means of them.
    if (coloured && texture >= 2 * size)
        for (int k = 0; k < 2; ++k) look.texture = binomialMean(graph, look.texture);
    const Tensor drawnTexels = look.texture;
    std::optional<CaptureLight> light;
    std::vector<float> fixedLight = start.light;
    if (movesGains) fixedLight.resize(kLightNumbers);  // even without: gains act where a light does
    if (movesLight)
        light.emplace(graph, body, faces, texture, graph.parameter(state.light, "light"));
    else if (coloured)
        light.emplace(graph, body, faces, texture, fixedLight);

    constexpr uint32_t kFrameWord = offsetof(StepParams, frame) / 4;
    Tensor table = graph.attach(corrections.section(Parameters::kValues), {frames, kPoseRow});
    Tensor gainTable;
    if (movesGains) gainTable = graph.attach(state.gains.section(Parameters::kValues), {frames, 3});
    Tensor given = graph.constant(std::span<const float>(start.poses), {frames, kPoseRow});
    Tensor bends = graph.constant(std::span<const float>(startBends(start.poses, state.transScale)),
                                  {frames, kPoseRow});
    Tensor joints = graph.constant(std::span<const float>(jointWeights(coloured)), {kJointCount});
    PosePriorWeights prior;
    prior.pose = static_cast<float>(preset.priorTheta);
    prior.trans = static_cast<float>(preset.priorTrans) * state.transScale * state.transScale;
    prior.smooth = start.video ? static_cast<float>(preset.smoothTheta) : 0.0f;
    auto weights = [](double a, double b, double c, double d) {
        return PyramidWeights{static_cast<float>(a), static_cast<float>(b), static_cast<float>(c),
                              static_cast<float>(d)};
    };
    // How places face the camera. Where poses are off, surfaces crease, and sides of a crease would
    // learn from other views than the skin around them does: they look where the bare body does,
    // where that is asked for.
    Tensor powers, byBare;
    SparseMatrix looks;
    if (movesTexels && std::max(preset.facingFace, preset.facingFew) > preset.facing) {
        std::vector<float> power, share;
        for (uint8_t face : body.face) {
            const double byBody = std::max(face ? preset.facingFace : 0., preset.facingFew);
            power.push_back(static_cast<float>(std::max(byBody, preset.facing)));
            share.insert(share.end(), 3, byBody > preset.facing ? 1.0f : 0.0f);
        }
        powers = graph.constant(std::span<const float>(power), {V, 1});
        byBare = graph.constant(std::span<const float>(share), {V, 3});
        looks = viewNormals(body, preset.facingMiddle);
    } else if (coloured && preset.facing > 0) {
        std::vector<float> rows(static_cast<size_t>(4 * V));
        for (size_t i = 3; i < rows.size(); i += 4) rows[i] = static_cast<float>(preset.facing);
        look.facing = graph.constant(std::span<const float>(rows), {V, 4});
    }
    const bool seesFaces = start.faces && preset.facePoints > 0;
    const SparseMatrix facePoints = seesFaces ? matrixOf(body.facePoints, V) : SparseMatrix();
    const SurfaceOptions drawing{.samples = preset.samples};
    for (int i = 0; i < preset.batch; ++i)
        poseSteps.push_back(graph.input({sizeof(StepParams) / 4}, ElementType::I32));
    std::vector<Tensor> rows, gainRows;
    for (const Tensor& poseStep : partOf(options.ranks, poseSteps)) {
        Sample sample;
        sample.camera = graph.input(kCameraShape);
        sample.mask = graph.input({size, size});
        sample.counts = graph.input({size, size});
        sample.scale = graph.input({1});
        Tensor correction = selectRow(graph, table, poseStep, kFrameWord);
        if (start.movesPoses) graph.watch(correction);
        rows.push_back(correction);
        Pose pose = poseCorrection(graph, selectRow(graph, given, poseStep, kFrameWord), correction,
                                   state.transScale);
        PosedBody posed = lbs(graph, skin, rest, pose.theta, beta, pose.trans);
        if (coloured) {
            sample.image = graph.input({size, size, 3});
            sample.background = graph.input({size, size, 3});
            look.background = sample.background;
            look.teaches = sample.mask;
            if (byBare) {
                Tensor skinned = lbs(graph, skin, bare, pose.theta, beta, pose.trans).verts;
                Tensor normals = sparseProduct(graph, looks, vertexNormals(graph, skinned, mesh));
                look.facing = concat(graph, multiply(graph, byBare, normals), powers);
            }
            Tensor gain;
            if (movesGains) {
                gainRows.push_back(selectRow(graph, gainTable, poseStep, kFrameWord));
                graph.watch(gainRows.back());
                gain = scaleShift(graph, gainRows.back(), 1, 1);
            }
            look.texture = light->lit(drawnTexels, posed.verts, gain);
        }
        SurfaceRender drawn = surfaceRender(graph, faces, posed.verts, sample.camera,
                                            coloured ? &look : nullptr, size, size, drawing);
        losses.term("silhouette", preset.silhouette,
                    pyramidLoss(graph, drawn.alpha, sample.mask, sample.counts, sample.scale,
                                weights(preset.silhouette1, preset.silhouette2, preset.silhouette4,
                                        preset.silhouette8)));
        if (coloured)  // the mean of the channels
            losses.term(
                "colour", preset.colour / 3,
                pyramidLoss(graph, drawn.image, sample.image, sample.counts, sample.scale,
                            weights(preset.colour1, preset.colour2, preset.colour4, preset.colour8),
                            static_cast<float>(preset.robust)));
        if (start.keypoints && preset.keypoints > 0) {
            sample.joints = graph.input({kJointCount, 3});
            losses.term("keypoints", preset.keypoints,
                        keypointLoss(graph, posed.joints, sample.joints, sample.camera,
                                     kKeypointScale * static_cast<float>(size * preset.samples)));
        }
        if (seesFaces) {
            sample.face = graph.input({facePoints.rows(), 3});
            losses.term("face", preset.facePoints,
                        keypointLoss(graph, sparseProduct(graph, facePoints, posed.verts),
                                     sample.face, sample.camera,
                                     kFaceScale * static_cast<float>(size * preset.samples)));
        }
        if (start.movesPoses)
            losses.term(
                "prior", 1,
                posePrior(graph, correction, selectRow(graph, table, poseStep, kFrameWord, -1),
                          selectRow(graph, table, poseStep, kFrameWord, 1),
                          selectRow(graph, bends, poseStep, kFrameWord), joints, beta, prior));
        samples.push_back(sample);
    }
    if (start.movesOffsets) {
        // A hand that was bent before is as stiff as a flat one, and toes that are closed stay so.
        std::vector<float> before = start.offsets;
        std::vector<float> shares = handShares(body);
        if (state.toes.rows() > 0)
            std::ranges::transform(shares, toeShares(body), shares.begin(), std::plus());
        for (size_t i = 0; i < before.size(); ++i) before[i] *= -shares[i / 3];
        losses.term(
            "offsets", 1,
            offsetPenalty(
                graph, add(graph, own, graph.constant(std::span<const float>(before), {V, 3})),
                graph.constant(surfaceStiffness(body, preset.hands, preset.face), {V}), mesh,
                static_cast<float>(preset.stay), static_cast<float>(preset.smooth)));
        if (preset.folds > 0) {
            std::vector<float> first = body.templateVertices;
            std::ranges::transform(first, start.offsets, first.begin(), std::plus());
            losses.term(
                "folds", preset.folds,
                foldPenalty(graph, straight, graph.constant(std::span<const float>(first), {V, 3}),
                            graph.constant(foldWeights(body, first), {body.faceCount}), mesh,
                            kLeastFace));
        }
    }
    if (movesTexels && preset.stayTexels > 0) {
        // Their mean square counts as one frame's word among all.
        const double weight = preset.stayTexels / static_cast<double>(frames);
        const auto count = static_cast<size_t>(texture * texture);
        Tensor first = graph.constant(std::span<const float>(start.texels), {texture, texture, 3});
        Tensor ones = graph.constant(std::vector<float>(count, 1.0f), {texture, texture});
        Tensor mean = graph.constant(std::vector<float>{1 / static_cast<float>(3 * count)}, {1});
        losses.term("texels", weight, pyramidLoss(graph, albedo, first, ones, mean, {.cell1 = 1}));
    }
    SparseMatrix differences;
    if (movesTexels && preset.seams > 0)
        differences = seamDifferences(body, static_cast<int>(texture));
    if (differences.rows() > 0) {
        // The mean square, as of one picture with a pixel for each texel along the seams.
        const Shape across{1, differences.rows(), 3}, pixels{1, differences.rows()};
        const auto count = static_cast<size_t>(differences.rows());
        Tensor nothing = graph.constant(std::vector<float>(3 * count), across);
        Tensor ones = graph.constant(std::vector<float>(count, 1.0f), pixels);
        Tensor mean = graph.constant(std::vector<float>{1 / static_cast<float>(3 * count)}, {1});
        losses.term("seams", preset.seams,
                    pyramidLoss(graph, sparseProduct(graph, differences, albedo).reshaped(across),
                                nothing, ones, mean, {.cell1 = 1}));
    }
    graph.backward(losses.sum());

    auto updateRows = [&](const Parameters& parameters, const Tensor& values,
                          const std::vector<Tensor>& drawn, const AdamWOptions& optimiser) {
        const std::vector<Tensor> gradients = rowGradients(graph, drawn);
        for (size_t i = 0; i < poseSteps.size(); ++i)
            adamwRow(graph, values, gradients[i],
                     graph.attach(parameters.section(Parameters::kMoment1), values.shape),
                     graph.attach(parameters.section(Parameters::kMoment2), values.shape),
                     optimiser, poseSteps[i]);
    };
    if (start.movesPoses)
        updateRows(corrections, table, rows, withRate(kPoseOptimiser, preset.lrTheta));
    if (movesGains)
        updateRows(state.gains, gainTable, gainRows, withRate(kGainOptimiser, preset.lrGain));
    if (start.movesOffsets) {
        auto section = [&](Parameters::Section which) {
            return graph.attach(offsets.view(*offsets.find("offsets"), which), {V, 3});
        };
        uniformAdam(
            graph, section(Parameters::kValues), section(Parameters::kGradient),
            section(Parameters::kMoment1), section(Parameters::kMoment2),
            [&](const Tensor& x) {
                return smoothSolve(graph, x, mesh, static_cast<float>(preset.lambda));
            },
            withRate(kSurfaceOptimiser, preset.lrOffsets));
    }
    if (movesHands) adamwStep(graph, state.hands, withRate(kHandOptimiser, preset.lrHands));
    if (movesTexels) adamwStep(graph, texels, withRate(kSurfaceOptimiser, preset.lrTexels));
    if (movesLight) adamwStep(graph, state.light, withRate(kLightOptimiser, preset.lrLight));
    graph.step();  // is written whether offsets or texels move or not
    graph.compile(options);
}

std::vector<float> SurfaceState::poses() const {
    return correctedPoses(start.poses, corrections.read(*corrections.find("correction")),
                          transScale);
}

HandAmounts SurfaceState::handValues() const {
    HandAmounts amounts = start.hands;
    if (hands.entries().empty()) return amounts;
    const std::vector<float> moved = hands.read(*hands.find("hands"));
    for (size_t i = 0; i < amounts.size(); ++i)
        amounts[i] = std::clamp(amounts[i] + moved[i], kLeastHand, kMostHand);
    return amounts;
}

std::vector<float> SurfaceState::unmoved() const {
    std::vector<float> rest = toes.times(start.offsets, 3);
    std::ranges::transform(start.offsets, rest, rest.begin(), std::minus());
    return rest;
}

std::vector<float> SurfaceState::offsetValues() const {
    std::vector<float> values = offsets.read(*offsets.find("offsets"));
    if (toes.rows() > 0) {
        values = toes.times(values, 3);
        std::ranges::transform(values, unmoved(), values.begin(), std::plus());
    }
    if (hands.entries().empty()) return values;
    std::ranges::transform(values, bare, values.begin(), std::plus());
    values = bentFingers(fingers, values, handValues());
    std::ranges::transform(values, bare, values.begin(), std::minus());
    return values;
}

std::vector<float> SurfaceState::lightValues() const {
    return light.entries().empty() ? start.light : light.read(*light.find("light"));
}

std::vector<float> SurfaceState::gainValues() const {
    if (gains.entries().empty()) return {};
    std::vector<float> values = gains.read(*gains.find("gains"));
    for (float& value : values) ++value;
    return values;
}

std::vector<float> SurfaceState::texelValues() const {
    std::vector<float> values =
        binomialMean(texels.read(*texels.find("texels")), start.textureSize, start.textureSize, 3);
    for (size_t i = 0; i < values.size(); ++i)
        values[i] = std::clamp(values[i] + start.texels[i], 0.0f, 1.0f);
    return values;
}

}  // namespace doppel
