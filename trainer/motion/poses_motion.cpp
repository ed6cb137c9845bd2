// A poses.npz as a motion: poses without cameras.
#include <string>

#include "trainer/data/capture_notes.h"
#include "trainer/motion/estimates/estimate.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// betas may be missing; a 0-d `fps` is believed.
Motion readPosesMotion(const fs::path& path) {
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
            const bool is = begin.starts_with("PK\x03\x04") || path.extension() == ".npz";
            return is && !begin.empty() && !areEstimates(path);
        },
    .read = readPosesMotion,
}};

}  // namespace

}  // namespace doppel
