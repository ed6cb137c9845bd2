// Estimators' poses and AMASS's motions as motions: of the person with most poses.
#include "trainer/motion/estimates/estimate_motion.h"

#include <algorithm>

#include "engine/error.h"
#include "engine/files/ending.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Of the clip's size nothing is known, nor does it matter for a motion.
constexpr Camera kCamera{1663, 1663, 960, 540, 1920, 1080};

// `pictures` after the last one.
void append(Motion& motion, const Theta& theta, const Trans& trans, int64_t pictures) {
    constexpr int64_t kMost = 1'000'000;
    if (pictures > kMost - static_cast<int64_t>(motion.size()))
        throwInput("{}: expected poses of at most {} pictures, found more", motion.source.string(),
                   kMost);
    for (int64_t k = 1; k <= pictures; ++k) {
        if (k == pictures) {
            motion.theta.push_back(theta);
            motion.trans.push_back(trans);
            break;
        }
        const double share = static_cast<double>(k) / static_cast<double>(pictures);
        const size_t last = motion.size() - static_cast<size_t>(k);
        const Theta turned = thetaBetween(motion.theta[last], theta, share);
        const Trans moved = transBetween(motion.trans[last], trans, share);
        motion.theta.push_back(turned);
        motion.trans.push_back(moved);
    }
}

}  // namespace

Motion motionFromEstimates(const Estimates& estimates) {
    const fs::path& path = estimates.source;
    const EstimatedPerson& person = *std::ranges::max_element(
        estimates.people, {}, [](const EstimatedPerson& p) { return p.poses.size(); });
    Motion motion;
    motion.source = path;
    motion.name = fs::absolute(path).lexically_normal().stem().string();
    if (estimates.fps) motion.fps = *estimates.fps;
    if (person.betas) {
        motion.betas = *person.betas;
        motion.shape = person.shape;
        requireFinite(motion.betas, path.string() + ": betas", motion.betas.size(),
                      kMostDeviations);
    }
    motion.note = estimates.program;
    if (estimates.people.size() > 1)
        motion.note += fmt::format(", person {} of {} people, who has most poses", person.name,
                                   estimates.people.size());
    motion.note +=
        estimates.fps ? fmt::format(", {:g} a second", motion.fps) : ", taken to be 30 a second";
    const EstimatedPose* before = nullptr;
    for (const EstimatedPose& pose : person.poses) {
        const int64_t step = before == nullptr ? 1 : pose.picture - before->picture;
        if (pose.world) {
            append(motion, pose.world->theta, pose.world->trans, step);
        } else {
            const PlacedPose placed = placePose(pose, pose.views[0], kCamera);
            append(motion, placed.theta, placed.trans, step);
        }
        before = &pose;
    }
    std::vector<float> numbers;
    for (const Trans& trans : motion.trans)
        numbers.insert(numbers.end(), trans.begin(), trans.end());
    requireFinite(numbers, path.string(), 3, kMostMetres);
    return motion;
}

namespace {

const MotionFormat kEstimates{{
    .looks = "other programs' poses (AMASS, 4D-Humans, WHAM, GVHMR, ROMP, VIBE, SPIN, EasyMocap)",
    .recognises =
        [](const fs::path& path, std::string_view begin) {
            // Pickles; archives and folders are looked into where poses.npz and captures are read.
            const std::string ending = endingOf(path);
            return begin.size() > 2 &&
                   (begin[0] == '\x80' ||
                    (begin[0] == 'x' && (ending == ".pkl" || ending == ".pth")));
        },
    .read = [](const fs::path& path) { return motionFromEstimates(readEstimates(path)); },
}};

}  // namespace

}  // namespace doppel
