#include "trainer/stages/fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "nn/ops/fit.h"
#include "nn/steps/fit_step.h"
#include "trainer/data/body_render.h"
#include "trainer/data/progress.h"
#include "trainer/data/shared_work.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/eval/metrics.h"
#include "trainer/person/heads.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

namespace {

// The given poses may be off by more than the method's box allows for.
constexpr double kFitMargin = 1.2;

// Whether it is known where a face looks and where its points are: then so is where the head has to
// be, and the neck may go there.
bool seesHeads(const Capture& capture) {
    const auto keypoints = capture.source.find("keypoints");
    return capture.source.contains("heads") && capture.keypoints &&
           keypoints != capture.source.end() && keypoints->second.starts_with(kOwnKeypoints);
}

FitStart fitStart(const Capture& capture, bool fitShape) {
    FitStart start{.betas = capture.betas,
                   .fitShape = fitShape,
                   .video = isVideo(capture),
                   .keypoints = capture.keypoints.has_value(),
                   .heads = seesHeads(capture)};
    for (size_t i = 0; i < capture.size(); ++i) {
        start.poses.insert(start.poses.end(), capture.theta[i].begin(), capture.theta[i].end());
        start.poses.insert(start.poses.end(), capture.trans[i].begin(), capture.trans[i].end());
    }
    return start;
}

// In the pixels of a crop.
std::vector<float> inCrop(std::vector<float> targets, const CropBox& box, int size) {
    const double scale = size / (2 * box.half);
    for (size_t j = 0; j < targets.size(); j += 3) {
        targets[j] = static_cast<float>((targets[j] - (box.centreX - box.half)) * scale);
        targets[j + 1] = static_cast<float>((targets[j + 1] - (box.centreY - box.half)) * scale);
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

// Of a large frame silhouettes are compared in every n-th pixel of every n-th row: a thousand
// frames of 4K took minutes, and a million pixels say as much.
int pixelStep(const Camera& camera) {
    constexpr int kLargest = 1536;
    const int longer = std::max(camera.width, camera.height),
              shorter = std::min(camera.width, camera.height);
    return std::min((longer + kLargest - 1) / kLargest, shorter);
}

// The pixels step · i + step / 2 along both axes, as many as are whole.
std::vector<uint8_t> pixelsOf(const Picture& picture, int step) {
    std::vector<uint8_t> pixels;
    for (int y = 0; y < picture.height / step; ++y)
        for (int x = 0; x < picture.width / step; ++x)
            pixels.push_back(picture.mask[static_cast<size_t>(step * y + step / 2) *
                                              static_cast<size_t>(picture.width) +
                                          static_cast<size_t>(step * x + step / 2)]);
    return pixels;
}

// A pixel's centre is that of the one above.
Camera cameraOfPixels(const Camera& camera, int step) {
    const double shift = step % 2 == 0 ? .5 : 0;
    return {camera.fx / step,           camera.fy / step,    (camera.cx - shift) / step,
            (camera.cy - shift) / step, camera.width / step, camera.height / step};
}

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) /
           static_cast<double>(std::max<size_t>(1, values.size()));
}

}  // namespace

bool isVideo(const Capture& capture) {
    if (capture.source.contains("chosen")) return false;
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

std::vector<std::vector<float>> jointTargets(const BodyModel& body, const Capture& capture) {
    if (!capture.keypoints) return {};
    const Keypoints& keypoints = *capture.keypoints;
    const std::span<const int> joints = keypointJoints(keypoints.scheme);
    std::vector<std::vector<float>> targets;
    for (size_t f = 0; f < capture.size(); ++f) {
        std::vector<float> target(kJointCount * 3);
        const auto point = [&](size_t k) {
            const float* p = &keypoints.values[3 * (f * static_cast<size_t>(keypoints.count) + k)];
            return std::array<float, 3>{p[0], p[1], p[2]};
        };
        const auto want = [&](size_t joint, const std::array<float, 3>& seen) {
            if (seen[2] > target[3 * joint + 2]) std::ranges::copy(seen, &target[3 * joint]);
        };
        for (size_t k = 0; k < joints.size(); ++k)
            if (joints[k] >= 0) want(static_cast<size_t>(joints[k]), point(k));
        if (seesHeads(capture)) {
            FacePoints face;
            std::ranges::transform(keypointFace(keypoints.scheme), face.begin(), point);
            const glm::dvec3 head =
                jointPlaces(body, capture.betas, capture.theta[f], capture.trans[f])[joint::kHead];
            want(joint::kHead,
                 headJointSeen(body, capture.theta[f], head, face, capture.frames[f].camera));
        }
        targets.push_back(std::move(target));
    }
    return targets;
}

std::vector<std::vector<double>> silhouetteIous(Device& device, const BodyModel& body,
                                                std::initializer_list<const Capture*> posed,
                                                FrameCache& frames, Ranks* ranks) {
    CHECK(posed.size() > 0, "there are poses to compare");
    const Capture& capture = **posed.begin();
    capture.requireMasks();
    BodyPoser poser(device, body);
    MeshDrawer drawer(device, body);
    std::vector<size_t> mine;
    for (size_t i = 0; i < capture.size(); ++i)
        if (isMine(ranks, i)) mine.push_back(i);
    std::vector<std::vector<double>> ious(posed.size());
    Progress progress("silhouettes", static_cast<int64_t>(mine.size()), kQuiet);
    inParallel(
        mine.size(),
        [&](size_t k) {
            return pixelsOf(*frames.loadMask(mine[k]), pixelStep(capture.frames[mine[k]].camera));
        },
        [&](size_t k, const std::vector<uint8_t>& pixels) {
            const size_t i = mine[k];
            const Camera& frame = capture.frames[i].camera;
            const Camera camera = cameraOfPixels(frame, pixelStep(frame));
            for (size_t p = 0; p < posed.size(); ++p) {
                const Capture& poses = *posed.begin()[p];
                const PosedMesh mesh = poser.pose(poses.theta[i], poses.trans[i], poses.betas);
                ious[p].push_back(intersectionOverUnion(drawer.mask(mesh.verts, camera), pixels));
            }
            progress.update(static_cast<int64_t>(k) + 1);
        });
    for (std::vector<double>& each : ious) each = ofAllRanks(ranks, capture.size(), each);
    return ious;
}

FitResult fitResult(Device& device, const BodyModel& body, const Capture& before,
                    const Capture& after, FrameCache& frames, Ranks* ranks) {
    std::vector<std::vector<double>> ious =
        silhouetteIous(device, body, {&before, &after}, frames, ranks);
    return {mean(ious[0]), mean(ious[1]), std::move(ious[0]), std::move(ious[1])};
}

FitResult fitCapture(Device& device, const BodyModel& body, Capture& capture,
                     const FitSettings& settings) {
    FitPreset preset = settings.preset;
    preset.batch = std::min(preset.batch, static_cast<int>(capture.size()));
    FrameCache cache(capture);
    Capture fitted = capture;
    unwrap(fitted.theta);
    TrainingFrames frames(device, body, fitted, cache, preset.size,
                          {.margin = kFitMargin, .ranks = settings.loop.ranks});
    FitStart start = fitStart(fitted, settings.fitShape);
    Ranks* sharing = settings.loop.sharing(preset.batch);
    FitStep step(device, body, start, preset,
                 {.memoryBudget = settings.memoryBudget,
                  .timestamps = settings.loop.profileSteps > 0,
                  .ranks = sharing});

    const std::vector<std::vector<float>> targets = jointTargets(body, capture);

    FrameSampler sampler(fitted.size(), settings.loop.seed);
    std::vector<uint32_t> visits(fitted.size());
    const int64_t taken = int64_t{preset.passes} * int64_t(fitted.size());
    StageLoop loop{.stage = "fit", .steps = (taken + preset.batch - 1) / preset.batch};
    loop.follow(step.graph, step.losses);
    loop.sharing = sharing;
    loop.identity = {{"frames", fmt::format("{}", fitted.size())}};
    loop.trained = {{"corrections", &step.corrections}, {"shape", &step.shape}};
    loop.frameName = [&](size_t frame) { return fitted.frames[frame].name; };
    loop.draw = [&] {
        std::vector<size_t> drawn = sampler.next(preset.batch);
        for (size_t frame : drawn) ++visits[frame];
        return drawn;
    };
    loop.submit = [&](int64_t i, const std::vector<size_t>& drawn) {
        double rate = scheduledRate(preset.lrTheta, preset.constantPart, i, loop.steps);
        for (size_t k = drawn.size(); k-- > 0;) {
            StepParams params =
                adamwStepParams(visits[drawn[k]], static_cast<float>(rate), kFitOptimiser);
            params.frame = static_cast<uint32_t>(drawn[k]);
            step.graph.write(step.poseSteps[k], wordsOf(params));
            step.graph.setStep(params);  // in the end, the first frame's
        }
        // A wide band at first, in which far limbs are felt; a sharp one at the end.
        double done = static_cast<double>(i) / static_cast<double>(loop.steps);
        double narrow = std::min(1.0, done / 0.6);
        double sigma = preset.sigmaStart * std::pow(preset.sigma / preset.sigmaStart, narrow);
        double radius = sigma * std::log(1 / 1e-4 - 1);
        const std::span<const size_t> mine = partOf(sharing, drawn);
        for (size_t k = 0; k < mine.size(); ++k) {
            const FitStep::Sample& sample = step.samples[k];
            const size_t frame = mine[k];
            step.graph.write(sample.camera,
                             cameraValues(rasterCamera(frames.camera(frame), sigma, radius)));
            step.graph.write(sample.target, frames.mask(frame));
            if (sample.keypoints)
                step.graph.write(sample.keypoints,
                                 inCrop(targets[frame], frames.box(frame), preset.size));
        }
        step.graph.submit();
    };
    if (!loop.run(settings.loop)) return {};

    std::vector<float> poses = step.poses();
    for (size_t f = 0; f < fitted.size(); ++f) {
        const float* pose = &poses[f * size_t(kPoseRow)];
        std::copy_n(pose, kThetaSize, fitted.theta[f].begin());
        std::copy_n(pose + kThetaSize, 3, fitted.trans[f].begin());
    }
    fitted.betas = step.betas();
    // Outlines and joints turn trunks, do not see faces, and would take the head along. A head that
    // was given on its neck gathers the errors of all joints below and stays there.
    if (capture.source.contains("heads"))
        aimHeads(body, capture.theta, fitted.theta, start.heads ? 0 : .5);
    // Both now, so that a mask is decoded once, and nobody waits for it before the first step.
    FitResult result = fitResult(device, body, capture, fitted, cache, settings.loop.ranks);
    capture.betas = fitted.betas;
    capture.theta = fitted.theta;
    capture.trans = fitted.trans;
    return result;
}

namespace {

FitSettings settingsOf(const TrainResult& result, const TrainSettings& settings) {
    FitSettings fit{.preset = result.avatar.preset.fit,
                    .loop = settings,
                    .memoryBudget = settings.memoryBudget};
    // What a body of another shape leaves open in a few outlines, bends of its spine would answer,
    // and arms hang elsewhere: many frames tell shape and pose apart, few do not.
    if (result.capture.size() <= kFewPictures)
        fit.preset.priorTheta = std::max(fit.preset.priorTheta, fit.preset.priorFew);
    if (!settings.hasFolder()) fit.loop.out.clear();
    return fit;
}

}  // namespace

void trainFit(Device& device, TrainResult& result, const TrainSettings& settings) {
    result.fit =
        fitCapture(device, result.avatar.body, result.capture, settingsOf(result, settings));
    result.avatar.betas = result.capture.betas;
}

void fitBelowClothes(Device& device, TrainResult& result, const TrainSettings& settings) {
    constexpr double kFitted = 100;
    FitSettings fit = settingsOf(result, settings);
    fit.preset.priorTheta *= kFitted;
    fit.loop.out.clear();
    fit.loop.profileSteps = 0;
    fitCapture(device, result.avatar.body, result.capture, fit);
    result.avatar.betas = result.capture.betas;
}

void planFit(Device& device, const Avatar& avatar, const Capture& capture,
             const TrainSettings& settings) {
    FitStep(device, avatar.body, fitStart(capture, true), avatar.preset.fit,
            settings.compileOptions(settings.sharing(avatar.preset.fit.batch)));
}

}  // namespace doppel
