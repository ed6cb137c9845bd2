// Estimators' poses and AMASS's motions as motions: of the person with most poses.
#include <algorithm>

#include "engine/error.h"
#include "trainer/motion/estimates/fields.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Of the clip's size nothing is known, nor does it matter for a motion.
constexpr Camera kCamera{1663, 1663, 960, 540, 1920, 1080};

// Pictures between two poses are filled along straight lines and shortest turns, so that the motion
// keeps its speed.
void append(Motion& motion, const Theta& theta, const Trans& trans, int64_t pictures) {
    constexpr int64_t kMost = 1'000'000;
    if (pictures > kMost - static_cast<int64_t>(motion.size()))
        throwInput("{}: expected poses of at most {} pictures, found more", motion.source.string(),
                   kMost);
    for (int64_t k = 1; k <= pictures; ++k) {
        const double share = static_cast<double>(k) / static_cast<double>(pictures);
        if (k == pictures) {
            motion.theta.push_back(theta);
            motion.trans.push_back(trans);
            break;
        }
        const size_t last = motion.size() - static_cast<size_t>(k);
        Theta between{};
        Trans place{};
        for (size_t j = 0; j < joint::kCount; ++j)
            setJointRotation(
                between, j,
                glm::slerp(jointRotation(motion.theta[last], j), jointRotation(theta, j), share));
        for (size_t c = 0; c < 3; ++c)
            place[c] = static_cast<float>((1 - share) * double(motion.trans[last][c]) +
                                          share * double(trans[c]));
        motion.theta.push_back(between);
        motion.trans.push_back(place);
    }
}

Motion readEstimatedMotion(const fs::path& path) {
    const Estimates estimates = readEstimates(path);
    const EstimatedPerson& person = *std::ranges::max_element(
        estimates.people, {}, [](const EstimatedPerson& p) { return p.poses.size(); });
    Motion motion;
    motion.source = path;
    motion.name = fs::absolute(path).lexically_normal().stem().string();
    if (estimates.fps) motion.fps = *estimates.fps;
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

const MotionFormat kEstimates{{
    .looks = "other programs' poses (AMASS, 4D-Humans, WHAM, GVHMR, ROMP, VIBE, SPIN, EasyMocap)",
    .recognises =
        [](const fs::path& path, std::string_view begin) {
            std::error_code error;
            const bool pickle =
                begin.size() > 2 && (begin[0] == '\x80' || begin[0] == 'x') &&
                (path.extension() == ".pkl" || path.extension() == ".pth" || begin[0] == '\x80');
            if (pickle) return true;
            const bool zip = begin.starts_with("PK\x03\x04");
            return (zip || fs::is_directory(path, error)) && areEstimates(path);
        },
    .read = readEstimatedMotion,
}};

}  // namespace

}  // namespace doppel
