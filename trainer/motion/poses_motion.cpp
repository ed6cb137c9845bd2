// Archives as motions: a poses.npz, which has no cameras, or another program's poses.
#include <string>

#include "engine/files/ending.h"
#include "trainer/data/capture_notes.h"
#include "trainer/motion/estimates/estimate_motion.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// betas may be missing; a 0-d `fps` is believed.
Motion readPosesMotion(const fs::path& path) {
    if (const auto estimates = findEstimates(path)) return motionFromEstimates(*estimates);
    Poses poses = readPoses(path, false);
    Motion motion;
    motion.source = path;
    motion.name = path.stem().string();
    if (poses.fps) motion.fps = checkedFps(*poses.fps, path.string() + ": fps");
    motion.theta = std::move(poses.theta);
    motion.trans = std::move(poses.trans);
    motion.betas = poses.betas;
    return motion;
}

const MotionFormat kPoses{{
    .looks = "a poses.npz",
    .recognises =
        [](const fs::path& path, std::string_view begin) {
            return begin.starts_with("PK\x03\x04") || (!begin.empty() && endingOf(path) == ".npz");
        },
    .read = readPosesMotion,
}};

}  // namespace

}  // namespace doppel
