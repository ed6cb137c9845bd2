#include "trainer/stages/fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "nn/ops/body.h"
#include "nn/ops/fit.h"
#include "nn/ops/loss.h"
#include "nn/ops/optim.h"
#include "nn/ops/raster.h"
#include "trainer/data/body_render.h"
#include "trainer/eval/metrics.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

namespace {

// The given poses may be off by more than the method's box allows for.
constexpr double kFitMargin = 1.2;
// Metres of translation per unit of correction: one learning rate serves radians and metres.
constexpr float kTransScale = 0.4f;

// A frame comes by once in a pass: short memories, and nothing that pulls poses to zero.
constexpr AdamWOptions kAdam{.beta1 = 0.5f, .beta2 = 0.95f, .weightDecay = 0};

// What it costs a joint to leave its given rotation, relative to the others. Silhouettes say little
// of hands, feet, head and the twist of the spine.
std::vector<float> jointWeights() {
    std::vector<float> weights(kJointCount, 1);
    for (size_t spine : {joint::kSpine1, joint::kSpine2, joint::kSpine3, joint::kNeck,
                         joint::kLeftCollar, joint::kRightCollar})
        weights[spine] = 2;
    for (size_t end : {joint::kHead, joint::kLeftWrist, joint::kRightWrist}) weights[end] = 4;
    for (size_t end : {joint::kLeftFoot, joint::kRightFoot, joint::kLeftHand, joint::kRightHand})
        weights[end] = 20;
    return weights;
}

// Whether frames follow each other closely enough to tell about each other: views from all sides do
// not. Rotations have been unwrapped.
bool isVideo(const Capture& capture) {
    std::vector<double> turns;
    for (size_t i = 1; i < capture.size(); ++i) {
        double sum = 0;
        for (size_t k = 0; k < 3; ++k) {
            double d = static_cast<double>(capture.theta[i][k] - capture.theta[i - 1][k]);
            sum += d * d;
        }
        turns.push_back(std::sqrt(sum));
    }
    if (turns.size() < 2) return false;
    std::ranges::nth_element(turns, turns.begin() + static_cast<long>(turns.size() / 2));
    return turns[turns.size() / 2] < 0.35;  // 20 degrees
}

// Everything of one gradient step on one frame.
struct FitStep {
    Parameters corrections, shape;  // outlive what the graph has under way
    Graph graph;
    Tensor camera, target, keypoints, iouLoss, loss;

    FitStep(Device& device, const BodyModel& body, const Capture& capture,
            const FitSettings& settings, int keypointCount)
        : graph(device) {
        const FitPreset& preset = settings.preset;
        auto frames = static_cast<int64_t>(capture.size());
        std::vector<float> start;
        for (size_t i = 0; i < capture.size(); ++i) {
            start.insert(start.end(), capture.theta[i].begin(), capture.theta[i].end());
            start.insert(start.end(), capture.trans[i].begin(), capture.trans[i].end());
        }
        corrections.add("correction", {frames, kPoseRow}, std::vector<float>(start.size()));
        corrections.allocate(device);
        shape.add("beta", {10}, {capture.betas.begin(), capture.betas.end()});
        shape.allocate(device);

        int64_t size = preset.size;
        camera = graph.input(kCameraShape);
        target = graph.input({size, size});
        constexpr uint32_t kFrameWord = offsetof(StepParams, frame) / 4;
        Tensor table = graph.attach(corrections.section(Parameters::kValues), {frames, kPoseRow});
        Tensor startTable = graph.constant(std::span<const float>(start), {frames, kPoseRow});
        Tensor correction = selectRow(graph, table, graph.step(), kFrameWord);
        Tensor before = selectRow(graph, table, graph.step(), kFrameWord, -1);
        Tensor after = selectRow(graph, table, graph.step(), kFrameWord, 1);
        graph.watch(correction);
        Tensor beta = settings.fitShape
                          ? graph.parameter(shape, "beta")
                          : graph.constant(std::span<const float>(capture.betas), {10});

        Pose pose = poseCorrection(graph, selectRow(graph, startTable, graph.step(), kFrameWord),
                                   correction, kTransScale);
        Tensor rest =
            graph.constant(std::span<const float>(body.templateVertices), {body.vertexCount, 3});
        PosedBody posed = lbs(graph, lbsModel(graph, body), rest, pose.theta, beta, pose.trans);
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        Tensor silhouette = softSilhouette(graph, mesh, posed.verts, camera, size, size);
        iouLoss = silhouetteIouLoss(graph, silhouette, target);

        bool video = isVideo(capture);
        PosePriorWeights weights;
        weights.pose = static_cast<float>(preset.priorTheta);
        weights.trans = static_cast<float>(preset.priorTheta);
        weights.smooth = video ? static_cast<float>(preset.smoothTheta) : 0.0f;
        weights.shape = static_cast<float>(preset.priorBeta);
        Tensor joints = graph.constant(std::span<const float>(jointWeights()), {kJointCount});
        Tensor prior = posePrior(graph, correction, before, after, joints, beta, weights);

        std::vector<WeightedTerm> terms{{iouLoss, 1.0f}, {prior, 1.0f}};
        if (keypointCount > 0) {
            keypoints = graph.input({kJointCount, 3});
            Tensor error = keypointLoss(graph, posed.joints, keypoints, camera,
                                        static_cast<float>(preset.size) * 0.04f);
            terms.push_back({error, static_cast<float>(preset.keypoints)});
        }
        loss = weightedSum(graph, terms);
        graph.backward(loss);
        AdamWOptions options = kAdam;
        auto moments = [&](Parameters::Section section) {
            return graph.attach(corrections.section(section), {frames, kPoseRow});
        };
        graph.beginOp("adamw_row");
        adamwRow(graph, table, graph.gradient(correction), moments(Parameters::kMoment1),
                 moments(Parameters::kMoment2), options);
        if (settings.fitShape) {
            options.rateScale = static_cast<float>(preset.lrBeta / preset.lrTheta);
            adamwStep(graph, shape, options);
        }
        graph.output(loss);
        graph.output(iouLoss);
        graph.compile();
    }
};

// A frame's keypoints as one target per joint, in the crop's pixels.
std::vector<float> jointTargets(const Keypoints& keypoints, size_t frame, const CropBox& box,
                                int size) {
    std::vector<float> targets(kJointCount * 3);
    std::span<const int> joints = keypointJoints(keypoints.scheme);
    double scale = size / (2 * box.half);
    for (size_t k = 0; k < joints.size(); ++k) {
        if (joints[k] < 0) continue;
        const float* point =
            &keypoints.values[3 * (frame * static_cast<size_t>(keypoints.count) + k)];
        float* target = &targets[3 * static_cast<size_t>(joints[k])];
        if (point[2] <= target[2]) continue;
        target[0] = static_cast<float>((point[0] - (box.centreX - box.half)) * scale);
        target[1] = static_cast<float>((point[1] - (box.centreY - box.half)) * scale);
        target[2] = point[2];
    }
    return targets;
}

// The same rotation as axis-angle, nearest to the one before: so that a turning body has no jumps
// between which a prior would smooth.
void unwrap(std::vector<Theta>& theta) {
    for (size_t i = 1; i < theta.size(); ++i) {
        std::array<double, 3> v{theta[i][0], theta[i][1], theta[i][2]};
        double angle = std::hypot(v[0], v[1], v[2]);
        if (angle < 1e-6) continue;
        double best = INFINITY, bestScale = 1;
        for (int turns = -2; turns <= 2; ++turns) {
            double scale = (angle + turns * 6.283185307179586) / angle, distance = 0;
            for (size_t k = 0; k < 3; ++k) {
                double d = v[k] * scale - static_cast<double>(theta[i - 1][k]);
                distance += d * d;
            }
            if (distance < best) best = distance, bestScale = scale;
        }
        for (size_t k = 0; k < 3; ++k) theta[i][k] = static_cast<float>(v[k] * bestScale);
    }
}

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) /
           static_cast<double>(std::max<size_t>(1, values.size()));
}

}  // namespace

std::vector<double> silhouetteIous(Device& device, const BodyModel& body, const Capture& capture,
                                   FrameCache& frames) {
    capture.requireMasks();
    BodyPoser poser(device, body);
    MeshDrawer drawer(device, body);
    std::vector<double> ious;
    for (size_t i = 0; i < capture.size(); ++i) {
        PosedMesh posed = poser.pose(capture.theta[i], capture.trans[i], capture.betas);
        ious.push_back(intersectionOverUnion(drawer.mask(posed.verts, capture.frames[i].camera),
                                             frames.load(i)->mask));
    }
    return ious;
}

FitResult fitCapture(Device& device, const BodyModel& body, Capture& capture,
                     const FitSettings& settings) {
    const FitPreset& preset = settings.preset;
    FrameCache cache(capture);
    FitResult result;
    result.frameIouBefore = silhouetteIous(device, body, capture, cache);
    result.iouBefore = mean(result.frameIouBefore);

    Capture fitted = capture;
    unwrap(fitted.theta);
    TrainingFrames frames(device, body, fitted, cache, preset.size, false, kFitMargin);
    int keypointCount = capture.keypoints ? capture.keypoints->count : 0;
    FitStep step(device, body, fitted, settings, keypointCount);

    FrameSampler sampler(fitted.size(), settings.loop.seed);
    int64_t steps = int64_t{preset.passes} * static_cast<int64_t>(fitted.size());
    std::vector<uint32_t> visits(fitted.size());
    size_t frame = 0;
    std::array<size_t, 2> frameOfStep{};  // even and odd ones: two are under way at most
    StageLoop loop{.stage = "fit", .steps = steps, .columns = {"loss", "iou_loss"}};
    loop.identity = {{"frames", fmt::format("{}", fitted.size())}};
    loop.trained = {{"corrections", &step.corrections}, {"shape", &step.shape}};
    loop.draw = [&] {
        frame = sampler.next();
        ++visits[frame];
    };
    loop.submit = [&](int64_t i) {
        frameOfStep[static_cast<size_t>(i % 2)] = frame;
        double rate = scheduledRate(preset.lrTheta, preset.constantPart, i, steps);
        StepParams params = adamwStepParams(visits[frame], static_cast<float>(rate), kAdam);
        params.frame = static_cast<uint32_t>(frame);
        // A wide band at first, in which far limbs are felt; a sharp one at the end.
        double done = static_cast<double>(i) / static_cast<double>(steps);
        double narrow = std::min(1.0, done / 0.6);
        double sigma = preset.sigmaStart * std::pow(preset.sigma / preset.sigmaStart, narrow);
        double radius = sigma * std::log(1 / 1e-4 - 1);
        step.graph.setStep(params);
        step.graph.write(step.camera,
                         cameraValues(rasterCamera(frames.camera(frame), sigma, radius)));
        step.graph.write(step.target, frames.mask(frame));
        if (keypointCount > 0)
            step.graph.write(step.keypoints, jointTargets(*capture.keypoints, frame,
                                                          frames.box(frame), preset.size));
        step.graph.submit();
    };
    loop.report = [&](int64_t i, int back) {
        double loss = static_cast<double>(step.graph.readScalar(step.loss, back));
        double iouLoss = static_cast<double>(step.graph.readScalar(step.iouLoss, back));
        if (!std::isfinite(loss))
            throwMachine("fit: the loss became {} at step {} (frame {})", loss, i + 1,
                         fitted.frames[frameOfStep[static_cast<size_t>(i % 2)]].name);
        return StageLoop::Report{{{"loss", loss}, {"iou", 1 - iouLoss}}, {loss, iouLoss}};
    };
    loop.run(settings.loop);

    std::vector<float> rows = step.corrections.read(*step.corrections.find("correction"));
    for (size_t f = 0; f < fitted.size(); ++f) {
        const float* row = &rows[f * static_cast<size_t>(kPoseRow)];
        for (size_t k = 0; k < kThetaSize; ++k) fitted.theta[f][k] += row[k];
        for (size_t k = 0; k < 3; ++k) fitted.trans[f][k] += kTransScale * row[kThetaSize + k];
    }
    if (settings.fitShape) {
        std::vector<float> beta = step.shape.read(*step.shape.find("beta"));
        std::ranges::copy(beta, fitted.betas.begin());
    }
    result.frameIouAfter = silhouetteIous(device, body, fitted, cache);
    result.iouAfter = mean(result.frameIouAfter);
    capture.betas = fitted.betas;
    capture.theta = fitted.theta;
    capture.trans = fitted.trans;
    return result;
}

}  // namespace doppel
