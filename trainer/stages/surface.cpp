#include "trainer/stages/surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "nn/body/feet.h"
#include "nn/ops/fit.h"
#include "nn/steps/light.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/person/heads.h"
#include "trainer/stages/back_projection.h"
#include "trainer/stages/colours/hand_colours.h"
#include "trainer/stages/fit.h"
#include "trainer/stages/live_state.h"
#include "trainer/stages/prior/expected_look.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

namespace {

// The poses may be off by more than the method's box allows for.
constexpr double kMargin = 1.2;

std::vector<float> poseRows(const Capture& capture) {
    std::vector<float> rows;
    for (size_t i = 0; i < capture.size(); ++i) {
        rows.insert(rows.end(), capture.theta[i].begin(), capture.theta[i].end());
        rows.insert(rows.end(), capture.trans[i].begin(), capture.trans[i].end());
    }
    return rows;
}

void takeRows(Capture& capture, const std::vector<float>& rows) {
    for (size_t f = 0; f < capture.size(); ++f) {
        const float* row = &rows[f * size_t(kPoseRow)];
        std::copy_n(row, kThetaSize, capture.theta[f].begin());
        std::copy_n(row + kThetaSize, 3, capture.trans[f].begin());
    }
}

// What training found of the frames' gains, on top of those that FrameCache took out.
void takeGains(Capture& capture, const std::vector<float>& found) {
    if (found.empty()) return;
    capture.gains.resize(capture.size(), {1, 1, 1});
    for (size_t i = 0; i < found.size(); ++i) {
        float& gain = capture.gains[i / 3][i % 3];
        gain = std::clamp(gain * found[i], kLeastGain, kMostGain);
    }
}

// Three to sixteen frames, which have no mean of what each has elsewhere, and tell about each
// other.
bool isAFew(const Capture& capture) { return capture.size() >= 3 && capture.size() <= 16; }

// The preset with crops no larger than frames are: a crop has the frame's own pixels where it can
// (trainer/stages/training_frames.h), and beyond the frame there is nothing to learn. And with
// steps of no more frames than there are, what holds the surface counting as much beside them. Few
// frames are learnt by heart, poses that are off included, if steps go on for long; of eight there
// are enough for 500 steps. What one picture sees from its side, or two from opposite ones, no
// other sets right: there it has the outline's colours, and the first texels' are better.
SurfacePreset fitting(SurfacePreset preset, const Capture& capture) {
    const int frames = static_cast<int>(capture.size());
    const int batch = std::min(preset.batch, frames);
    // Of a frame, at most; those of three or four make an avatar in a minute on two cores.
    const int visits = frames > 4 ? 100 + 40 * (frames - 4) : frames > 2 ? 75 : 100;
    preset.steps = static_cast<int>(
        std::min<int64_t>(preset.steps, (int64_t{visits} * frames + batch - 1) / batch));
    if (frames <= 2) preset.facing = std::max(preset.facing, 4.);
    if (!isAFew(capture)) preset.facingFew = 0;
    for (double* weight : {&preset.stay, &preset.smooth, &preset.folds, &preset.stayTexels})
        *weight *= static_cast<double>(batch) / preset.batch;
    preset.batch = batch;
    int longest = 1;
    for (const Frame& frame : capture.frames)
        longest = std::max({longest, frame.camera.width, frame.camera.height});
    preset.size = std::min(preset.size, (longest + 15) / 16 * 16);
    return preset;
}

// The same over crops of half the size.
SurfacePreset halved(SurfacePreset preset) {
    preset.size = (preset.size / 2 + 15) / 16 * 16;
    return preset;
}

// The same over crops in which no frame shrinks, as far as kLargestCrop, for texels and poses
// alone: what a surface gains by such pixels are creases. The preset itself where frames do not
// shrink, or hardly.
SurfacePreset ownPixels(SurfacePreset preset, Device& device, const BodyModel& body,
                        const Capture& capture) {
    constexpr double kLargestCrop = 1024, kHardly = 1.1;
    BodyPoser poser(device, body);
    double side = 0;
    for (size_t i = 0; i < capture.size(); ++i) {
        const Frame& frame = capture.frames[i];
        const PosedMesh posed = poser.pose(capture.theta[i], capture.trans[i], capture.betas);
        const CropBox box = cropBox(frame.camera, posed.joints, "frame " + frame.name);
        side = std::max(side, 2 * kMargin * box.half);
    }
    const int size = static_cast<int>(std::ceil(std::min(side, kLargestCrop) / 16)) * 16;
    if (size >= kHardly * preset.size) {
        preset.size = size;
        preset.lrOffsets = preset.lrHands = 0;
    }
    return preset;
}

// Whether some frame shows a face, and it is known where its points are on the body.
bool showsFaces(const BodyModel& body, const Capture& capture) {
    return !body.facePoints.empty() &&
           std::ranges::any_of(capture.faces, [](const SeenFace& face) { return !face.empty(); });
}

// Points [P,3] (u, v, confidence) of a frame's picture as another camera at its place has them.
std::vector<float> seenBy(const Camera& to, const Camera& from, std::vector<float> points) {
    for (size_t i = 0; i < points.size(); i += 3) {
        points[i] = static_cast<float>((double{points[i]} - from.cx) / from.fx * to.fx + to.cx);
        points[i + 1] =
            static_cast<float>((double{points[i + 1]} - from.cy) / from.fy * to.fy + to.cy);
    }
    return points;
}

// Steps over crops of one size, from one step on.
struct Phase {
    int64_t begin;
    SurfacePreset preset;
};

// From coarse to fine: pixels of twice the size reach twice as far, in a quarter of the time.
std::vector<Phase> phasesOf(const SurfacePreset& preset, Device& device, const BodyModel& body,
                            const Capture& capture) {
    const SurfacePreset own = preset.fine > 0 ? ownPixels(preset, device, body, capture) : preset;
    const int64_t coarse = std::llround(preset.coarse * preset.steps),
                  fine = own.size == preset.size ? 0 : std::llround(preset.fine * preset.steps);
    const int64_t last = std::max(coarse, preset.steps - fine);
    std::vector<Phase> phases;
    if (coarse > 0) phases.push_back({0, halved(preset)});
    if (coarse < last) phases.push_back({coarse, preset});
    if (last < preset.steps) phases.push_back({last, own});
    return phases;
}

// What steps over crops of one size need.
struct Scale {
    TrainingFrames frames;
    SurfaceStep step;

    Scale(TrainingFrames crops, Device& device, const BodyModel& body, SurfaceState& state,
          const SurfacePreset& preset, const CompileOptions& options)
        : frames(std::move(crops)), step(device, body, state, preset, options) {}
};

}  // namespace

std::optional<SurfaceResult> runSurface(Device& device, const BodyModel& body, Capture& capture,
                                        const SurfaceRun& run) {
    const SurfacePreset preset = fitting(run.preset, capture);
    const bool coloured = !run.texels.empty();
    SurfaceState state(device, body,
                       {.poses = poseRows(capture),
                        .betas = capture.betas,
                        .offsets = body.offsets,
                        .texels = run.texels,
                        .textureSize = run.textureSize,
                        .light = run.light,
                        .hands = run.hands,
                        .movesOffsets = run.movesOffsets,
                        .movesTexels = run.movesTexels,
                        .video = isVideo(capture),
                        .faces = showsFaces(body, capture),
                        .keypoints = capture.keypoints.has_value()},
                       preset);
    FrameCache cache(capture);
    std::optional<BackgroundPlates> scene;
    if (coloured) scene.emplace(capture, cache, run.loop.ranks);
    const bool profiles = run.loop.profileSteps > 0;
    std::vector<Phase> phases = phasesOf(preset, device, body, capture);
    if (profiles) phases = {{0, preset}};
    auto phaseOf = [&](int64_t step) {
        size_t phase = 0;
        while (phase + 1 < phases.size() && step >= phases[phase + 1].begin) ++phase;
        return phase;
    };
    Ranks* sharing = run.loop.sharing(preset.batch);
    auto scaleOf = [&](const SurfacePreset& numbers, bool canStop) {
        TrainingFrames frames(device, body, capture, cache, numbers.size,
                              {.colours = coloured,
                               .margin = kMargin,
                               .memoryBudget = run.memoryBudget,
                               .edges = true,
                               .rim = coloured ? preset.rim : 0,
                               .scene = scene ? &*scene : nullptr,
                               .ranks = run.loop.ranks,
                               .canStop = canStop});
        return std::make_unique<Scale>(
            std::move(frames), device, body, state, numbers,
            CompileOptions{
                .memoryBudget = run.memoryBudget, .timestamps = profiles, .ranks = sharing});
    };
    const std::vector<std::vector<float>> joints = jointTargets(body, capture);
    std::vector<std::vector<float>> faces;
    if (state.start.faces && preset.facePoints > 0) {
        BodyPoser poser(device, body);
        for (size_t f = 0; f < capture.size(); ++f)
            faces.push_back(faceTargets(
                body, poser.pose(capture.theta[f], capture.trans[f], capture.betas).verts,
                capture.faces[f]));
    }
    size_t phase = 0;
    std::unique_ptr<Scale> scale = scaleOf(phases[phase].preset, true);
    bool started = false;
    std::vector<double> lastBefore;  // a phase's last losses, asked for when the next one has begun

    FrameSampler sampler(capture.size(), run.loop.seed + 41);
    std::vector<uint32_t> visits(capture.size());
    StageLoop loop{.stage = run.stage, .steps = preset.steps};
    loop.follow(scale->step.graph, scale->step.losses);
    loop.sharing = sharing;
    loop.values = [&](int64_t i, int back) {
        return phaseOf(i) < phase ? lastBefore : scale->step.losses.read(back);
    };
    loop.identity = run.identity;
    loop.identity["frames"] = fmt::format("{}", capture.size());
    loop.trained = {{"corrections", &state.corrections}};
    if (run.movesOffsets) loop.trained.emplace_back("offsets", &state.offsets);
    if (coloured && run.movesTexels) loop.trained.emplace_back("texels", &state.texels);
    if (!state.hands.entries().empty()) loop.trained.emplace_back("hands", &state.hands);
    if (!state.light.entries().empty()) loop.trained.emplace_back("light", &state.light);
    if (!state.gains.entries().empty()) loop.trained.emplace_back("gains", &state.gains);
    loop.frameName = [&](size_t frame) { return capture.frames[frame].name; };
    loop.draw = [&] {
        std::vector<size_t> drawn = sampler.next(preset.batch);
        for (size_t frame : drawn) ++visits[frame];
        return drawn;
    };
    loop.submit = [&](int64_t i, const std::vector<size_t>& drawn) {
        if (const size_t now = phaseOf(i); now != phase) {
            if (started) lastBefore = scale->step.losses.read(0);
            scale.reset();
            scale = scaleOf(phases[now].preset, false);  // the loop keeps a checkpoint first
            phase = now;
        }
        started = true;
        TrainingFrames& frames = scale->frames;
        SurfaceStep& step = scale->step;
        const double done =
            static_cast<double>(i) / static_cast<double>(std::max<int64_t>(1, loop.steps - 1));
        const auto rate = static_cast<float>(std::pow(preset.decay, done));
        for (size_t k = 0; k < drawn.size(); ++k) {
            StepParams row = adamwStepParams(visits[drawn[k]], rate, kPoseOptimiser);
            row.frame = static_cast<uint32_t>(drawn[k]);
            step.graph.write(step.poseSteps[k], wordsOf(row));
        }
        const std::span<const size_t> mine = partOf(sharing, drawn);
        for (size_t k = 0; k < mine.size(); ++k) {
            const SurfaceStep::Sample& sample = step.samples[k];
            const size_t frame = mine[k];
            Camera camera = frames.camera(frame);
            camera.fx *= preset.samples, camera.fy *= preset.samples;
            camera.cx *= preset.samples, camera.cy *= preset.samples;
            step.graph.write(sample.camera, cameraValues(rasterCamera(camera)));
            step.graph.write(sample.mask, frames.mask(frame));
            step.graph.write(sample.scale, std::vector<float>{frames.scale(frame)});
            step.graph.write(sample.counts, frames.inside(frame));
            if (sample.joints)
                step.graph.write(sample.joints,
                                 seenBy(camera, capture.frames[frame].camera, joints[frame]));
            if (sample.face)
                step.graph.write(sample.face,
                                 seenBy(camera, capture.frames[frame].camera, faces[frame]));
            if (!coloured) continue;
            step.graph.write(sample.image, frames.image(frame));
            step.graph.write(sample.background, frames.background(frame));
        }
        step.graph.setStep(adamwStepParams(static_cast<uint32_t>(i + 1), rate, kSurfaceOptimiser));
        step.graph.submit();
        frames.prepare(partOf(sharing, sampler.peek(preset.batch)));  // meanwhile
    };
    auto result = [&] {
        return SurfaceResult{state.offsetValues(),
                             coloured ? state.texelValues() : std::vector<float>(),
                             state.lightValues()};
    };
    if (run.picture) loop.picture = [&] { run.picture(result()); };
    if (!loop.run(run.loop)) return std::nullopt;
    takeRows(capture, state.poses());
    takeGains(capture, state.gainValues());
    return result();
}

namespace {

// Steps with which each frame is taken so many times.
int stepsForVisits(int times, const Capture& capture, const SurfacePreset& preset) {
    return std::max(1, times * static_cast<int>(capture.size()) / fitting(preset, capture).batch);
}

// Rounds of steps in which poses are fitted to pictures, each with rates that fall and priors from
// where it begins, go on while one still turns joints by as much as kSettled, radians, in the mean
// over their components. What turns by hardly less than in the round before does not settle: it
// wanders, for frames are too small to tell.
constexpr int kMostRounds = 4;
constexpr double kSettled = .013, kWanders = .9;
constexpr int kFewSteps = 100;

double turnedBetween(std::span<const Theta> before, std::span<const Theta> after) {
    double sum = 0;
    for (size_t f = 0; f < before.size(); ++f)
        for (size_t i = 0; i < before[f].size(); ++i)
            sum += std::abs(static_cast<double>(after[f][i]) - static_cast<double>(before[f][i]));
    return sum / static_cast<double>(before.size() * Theta().size());
}

}  // namespace

FitResult fitPosesToMasks(Device& device, const Avatar& avatar, Capture& capture, uint64_t seed) {
    capture.betas = avatar.betas;
    FitResult result =
        fitCapture(device, avatar.body, capture,
                   {.preset = avatar.preset.fit, .fitShape = false, .loop = {.seed = seed}});
    SurfaceRun run{.stage = "poses", .preset = avatar.preset.shape, .loop = {.seed = seed}};
    run.preset.steps = stepsForVisits(30, capture, run.preset);
    run.preset.facePoints = 0;  // a face is for who looks at pictures
    run.preset.lrTheta = .008;
    run.preset.lrTrans = .002;
    runSurface(device, avatar.body, capture, run);
    return result;
}

int fitPosesToPictures(Device& device, const Avatar& avatar, Capture& capture, uint64_t seed) {
    // Outlines have done their part: colours move poses freely, and by single pixels.
    SurfaceRun run{.stage = "poses",
                   .preset = avatar.preset.texels,
                   .texels = avatar.texture,
                   .textureSize = avatar.textureSize,
                   .light = avatar.light,
                   .loop = {.seed = seed}};
    run.preset.steps = stepsForVisits(80, capture, run.preset);
    // Few frames are few steps, in which poses settle only if rates fall far.
    run.preset.decay = run.preset.steps < kFewSteps ? .1 : .3;
    run.preset.lrTheta = .006;
    run.preset.lrTrans = .002;
    run.preset.priorTheta = .01;
    run.preset.priorTrans = .1;
    run.preset.colour2 = 1;
    run.preset.colour4 = 0;
    double before = std::numeric_limits<double>::max();
    for (int round = 1;; ++round) {
        const std::vector<Theta> start = capture.theta;
        runSurface(device, avatar.body, capture, run);
        const double turned = turnedBetween(start, capture.theta);
        if (round == kMostRounds || turned < kSettled || turned > kWanders * before) return round;
        before = turned;
    }
}

namespace {

// The given capture in poses that are fitted to pictures: each half, from the poses that it
// has, to the texture that the other half gives in the poses of `latest`, over small crops, for
// poses are off by many pixels.
Capture fittedToOthers(Device& device, const Avatar& avatar, const Capture& given,
                       const Capture& latest, const TrainSettings& settings) {
    constexpr int kTexels = 256;
    const SurfacePreset& preset = avatar.preset.texels;
    Capture fitted = given;
    for (const size_t half : {0u, 1u}) {
        std::vector<size_t> own, others;
        for (size_t f = 0; f < given.size(); ++f) (f % 2 == half ? own : others).push_back(f);
        Capture mine = given.subset(own), theirs = latest.subset(others);
        FrameCache cache(theirs);
        SurfaceRun run{.stage = "poses",
                       .preset = preset,
                       .texels = backProject(device, avatar.body, theirs, cache, kTexels,
                                             preset.rim, nullptr, settings.known)
                                     .texture,
                       .textureSize = kTexels,
                       .loop = {.seed = settings.seed},
                       .memoryBudget = settings.memoryBudget};
        run.preset.size = halved(preset).size;
        run.preset.coarse = run.preset.fine = 0;
        run.preset.steps = stepsForVisits(preset.others, mine, run.preset);
        run.preset.decay = .1;
        run.preset.lrTheta = .006;
        run.preset.lrTrans = .002;
        run.preset.priorTheta = .01;
        run.preset.priorTrans = .1;
        run.preset.lrLight = run.preset.lrGain = 0;
        runSurface(device, avatar.body, mine, run);
        for (size_t k = 0; k < own.size(); ++k) {
            fitted.theta[own[k]] = mine.theta[k];
            fitted.trans[own[k]] = mine.trans[k];
        }
    }
    return fitted;
}

// Outlines do not show where an arm is that hangs before the body, nor where a head looks, and
// colours that a frame has painted itself believe whatever pose it has: the arm is painted on the
// flank as well, and faces get several eyes. So a few frames are fitted to what the others show, in
// rounds, for the others were off as well. Each round begins with the given poses, or halves would
// take over each other's errors and go astray. Of many frames rounds take long, and two show sides
// of their own.
void fitPosesToOthers(Device& device, const Avatar& avatar, Capture& capture,
                      const TrainSettings& settings) {
    constexpr int kRounds = 3;
    if (avatar.preset.texels.others == 0 || !isAFew(capture)) return;
    const Capture given = capture;
    for (int round = 0; round < kRounds; ++round)
        capture = fittedToOthers(device, avatar, given, capture, settings);
}

// A stage's steps over crops of each size, those of the given poses.
void planSurface(Device& device, const Avatar& avatar, const Capture& capture,
                 const TrainSettings& settings, const SurfacePreset& asked, SurfaceStart start) {
    start.poses = poseRows(capture);
    start.betas = capture.betas;
    start.faces = showsFaces(avatar.body, capture);
    start.keypoints = capture.keypoints.has_value();
    const SurfacePreset preset = fitting(asked, capture);
    SurfaceState state(device, avatar.body, std::move(start), preset);
    for (const Phase& phase : phasesOf(preset, device, avatar.body, capture))
        SurfaceStep(device, avatar.body, state, phase.preset,
                    settings.compileOptions(settings.sharing(preset.batch)));
}

}  // namespace

void planShape(Device& device, const Avatar& avatar, const Capture& capture,
               const TrainSettings& settings) {
    planSurface(device, avatar, capture, settings, avatar.preset.shape, {});
}

void planTexels(Device& device, const Avatar& avatar, const Capture& capture,
                const TrainSettings& settings) {
    const int size = avatar.preset.texture.textureSize;
    const size_t numbers = 3 * static_cast<size_t>(size) * static_cast<size_t>(size);
    planSurface(device, avatar, capture, settings, avatar.preset.texels,
                {.texels = std::vector<float>(numbers), .textureSize = size});
}

std::vector<float> plannedLight(const Avatar& avatar, const TrainSettings& settings) {
    if (std::ranges::count(settings.stages, "texels") == 0) return avatar.light;
    return std::vector<float>(avatar.preset.texels.lrLight > 0 ? kLightNumbers : 0);
}

// As people let them hang who stand or walk.
constexpr HandAmounts kHandsAtEase{.5f, 1, .5f, 1};

void trainShape(Device& device, TrainResult& result, const TrainSettings& settings) {
    Avatar& avatar = result.avatar;
    result.capture.betas = avatar.betas;
    if (avatar.body.facePoints.empty() && avatar.preset.shape.facePoints > 0 &&
        std::ranges::any_of(result.capture.faces, [](const auto& face) { return !face.empty(); }))
        fmt::print(stderr,
                   "points of the face are left out: {} does not say where they are "
                   "(face_points; assets/README.md)\n",
                   avatar.body.file);
    FrameCache cache(result.capture);
    // Hands that have been learned before begin as they are.
    const bool first = avatar.body.offsets.empty();
    if (!settings.known.people.empty()) {
        constexpr int kTexels = 256;
        const FirstTexels seen =
            backProject(device, avatar.body, result.capture, cache, kTexels,
                        avatar.preset.texels.rim, settings.ranks, settings.known);
        setOffsets(avatar, offsetsOf(avatar.body, seen.heights));
        // Few frames do not show how deep a trunk is: there clothes would be added to a girth that
        // has them.
        if (result.capture.size() <= kFewPictures && std::ranges::count(settings.stages, "fit") > 0)
            fitBelowClothes(device, result, settings);
    }
    SurfaceRun run{.stage = "shape",
                   .preset = avatar.preset.shape,
                   .movesOffsets = true,
                   .loop = settings,
                   .memoryBudget = settings.memoryBudget,
                   .identity = stageIdentity(avatar, "shape")};
    if (first && run.preset.toes > 0) {
        std::vector<float> offsets = closedToes(avatar.body);
        if (!avatar.body.offsets.empty())
            std::ranges::transform(offsets, avatar.body.offsets, offsets.begin(), std::plus());
        setOffsets(avatar, offsets);
    }
    if (first)
        std::ranges::transform(kHandsAtEase, run.hands.begin(), [&](float amount) {
            return static_cast<float>(run.preset.ease) * amount;
        });
    if (!settings.hasFolder()) run.loop.out.clear();
    run.picture = [&](const SurfaceResult& state) {
        Avatar now = avatar;
        setOffsets(now, state.offsets);
        writeState(device, now, result.capture, cache, settings.out);
    };
    if (auto trained = runSurface(device, avatar.body, result.capture, run))
        setOffsets(avatar, trained->offsets);
}

namespace {

// Of many frames some may show what those that are looked at do not: what was learned there has
// left where it began.
void trustWhatMoved(std::span<const float> began, FirstTexels& first) {
    constexpr float kMoved = 4.f / 255;
    constexpr double kTrust = .01;  // as of what is seen from its side
    for (size_t i = 0; i < first.origin.size(); ++i) {
        if (first.origin[i] == kNoTexel || first.origin[i] == kFromFrames) continue;
        float moved = 0;
        for (size_t c = 3 * i; c < 3 * i + 3; ++c)
            moved = std::max(moved, std::abs(first.texture[c] - began[c]));
        if (moved < kMoved) continue;
        first.origin[i] = kFromFrames;
        first.trust[i] = kTrust;
    }
}

}  // namespace

void trainTexels(Device& device, TrainResult& result, const TrainSettings& settings) {
    Avatar& avatar = result.avatar;
    const int size = avatar.preset.texture.textureSize;
    result.capture.betas = avatar.betas;
    fitPosesToOthers(device, avatar, result.capture, settings);
    FrameCache cache(result.capture);
    FirstTexels first = backProject(device, avatar.body, result.capture, cache, size,
                                    avatar.preset.texels.rim, settings.ranks, settings.known);
    fmt::print(stderr,
               "{:.1f} % of the texture is seen in the frames, {:.1f} % is taken from the body's "
               "other side, {:.1f} % from its surroundings\n",
               100 * first.part(kFromFrames), 100 * first.part(kFromOtherSide),
               100 * first.part(kFromNeighbours));
    SurfaceRun run{.stage = "texels",
                   .preset = avatar.preset.texels,
                   .texels = std::move(first.texture),
                   .textureSize = size,
                   .movesOffsets = true,
                   .movesTexels = true,
                   .loop = settings,
                   .memoryBudget = settings.memoryBudget,
                   .identity = stageIdentity(avatar, "texels")};
    run.identity["texture.textureSize"] = fmt::format("{}", size);
    if (!settings.hasFolder()) run.loop.out.clear();
    auto take = [&](Avatar& to, const SurfaceResult& state) {
        setOffsets(to, state.offsets);
        to.textureSize = size;
        to.texels = to.texture = state.texels;
        to.texelsSeen = first.origin;
        to.light = state.light;
    };
    run.picture = [&](const SurfaceResult& state) {
        Avatar now = avatar;
        take(now, state);
        writeState(device, now, result.capture, cache, settings.out);
    };
    if (auto trained = runSurface(device, avatar.body, result.capture, run)) {
        // What no frame shows was filled before surface and poses had settled.
        setOffsets(avatar, trained->offsets);
        first = backProject(device, avatar.body, result.capture, cache, size,
                            avatar.preset.texels.rim, settings.ranks, settings.known);
        std::swap(first.texture, trained->texels);
        if (result.capture.size() > kProjectedFrames) trustWhatMoved(run.texels, first);
        fillUnseen(avatar.body, size, settings.known, first);
        std::swap(first.texture, trained->texels);
        if (avatar.preset.texels.cleanHands) cleanHands(avatar.body, size, trained->texels);
        // As eight bits keep them, so that a run that is stopped after this stage and one that is
        // not go on from the same.
        for (float& value : trained->texels) value = std::round(255 * value) / 255;
        take(avatar, *trained);
    }
}

}  // namespace doppel
