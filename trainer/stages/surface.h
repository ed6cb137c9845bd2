// Stages "shape" and "texels": a body's own surface from its frames (nn/steps/surface_step.h).
// Poses that are not the training's are fitted by the same steps, the surface as it is.
#pragma once

#include <optional>
#include <vector>

#include "nn/steps/surface_step.h"
#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/stages/stage.h"

namespace doppel {

struct SurfaceResult {
    std::vector<float> offsets, texels, light;  // of the body; [size,size,3]; Avatar::light
};

// What a run over a capture changes; the rest stays as it is.
struct SurfaceRun {
    std::string stage;
    SurfacePreset preset;
    std::vector<float> texels = {};  // [size,size,3] to start from; empty: silhouettes alone
    int textureSize = 0;
    std::vector<float> light = {};                   // Avatar::light
    HandAmounts hands = {};                          // how hands begin
    bool movesOffsets = false, movesTexels = false;  // poses always move
    LoopSettings loop = {};
    uint64_t memoryBudget = 0;
    std::map<std::string, std::string> identity = {};
    // Draws the present state; may be empty.
    std::function<void(const SurfaceResult&)> picture = {};
};
// Replaces capture.theta and trans, and gains where they are learned. Nothing where the run only
// profiled. The frames need masks.
std::optional<SurfaceResult> runSurface(Device& device, const BodyModel& body, Capture& capture,
                                        const SurfaceRun& run);

// The poses of frames that training did not see, the avatar being frozen: its body is fitted to
// their masks, and keypoints where there are some, first by the soft silhouette, which reaches far,
// then by edges. Replaces
// capture.theta, trans and betas, which become the avatar's. Returns what fitCapture() does.
FitResult fitPosesToMasks(Device& device, const Avatar& avatar, Capture& capture, uint64_t seed);

// From there on by the colours of the pictures as well, with the coarse texture and without the
// networks, in rounds, four at most, until they hardly turn any more: poses of another body's
// estimator have farther to go than the demo's. Replaces capture.theta and trans, and gains where
// the avatar was trained with them. Returns how many rounds it were.
int fitPosesToPictures(Device& device, const Avatar& avatar, Capture& capture, uint64_t seed);

}  // namespace doppel
