// Folders as motions: a capture's poses, with the cameras that saw them, or another program's.
#include <string>

#include "engine/error.h"
#include "trainer/data/capture_notes.h"
#include "trainer/motion/estimates/estimate_motion.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

Motion readCaptureMotion(const fs::path& folder) {
    std::error_code error;
    if (!fs::exists(folder / "poses.npz", error))
        if (const auto estimates = findEstimates(folder)) return motionFromEstimates(*estimates);
    Poses poses = readPoses(folder / "poses.npz", false);
    const CaptureNotes notes = readNotes(folder);
    if (!notes.frames.empty() && notes.frames.size() != poses.theta.size()) {
        throwInput(
            "{}: global_orient: expected {} rows, as many as capture.toml has frames, "
            "found {}",
            (folder / "poses.npz").string(), notes.frames.size(), poses.theta.size());
    }
    Motion motion;
    motion.source = folder;
    motion.name = notes.name;
    motion.fps = notes.fps;
    motion.theta = std::move(poses.theta);
    motion.trans = std::move(poses.trans);
    motion.betas = poses.betas;
    const fs::path cameras = folder / "cameras.npz";
    return fs::exists(cameras, error) ? throughCameras(std::move(motion), cameras) : motion;
}

const MotionFormat kCapture{{
    .looks = "a capture's folder",
    .recognises =
        [](const fs::path& path, std::string_view) {
            std::error_code error;
            return fs::is_directory(path, error);
        },
    .read = readCaptureMotion,
}};

}  // namespace

}  // namespace doppel
