// Stages "shape" and "texels": a body's own surface from its frames (nn/steps/surface_step.h). Poses
// that are not the training's are refined by the same steps with the surface as it is.
#pragma once

#include <optional>
#include <vector>

#include "nn/steps/surface_step.h"
#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/stages/stage.h"

namespace doppel {

// What a run over a capture changes; the rest stays as it is.
struct SurfaceRun {
    std::string stage;
    SurfacePreset preset;
    std::vector<float> texels = {};  // [size,size,3] to start from; empty: silhouettes alone
    int textureSize = 0;
    bool movesOffsets = false, movesTexels = false;  // poses always move
    LoopSettings loop = {};
    uint64_t memoryBudget = 0;
    std::map<std::string, std::string> identity = {};
    // Draws the present state from body offsets and texels; may be empty.
    std::function<void(const std::vector<float>& offsets, const std::vector<float>& texels)>
        picture = {};
};
struct SurfaceResult {
    std::vector<float> offsets, texels;
};
// Replaces capture.theta and trans. Nothing where the run only profiled. The frames need masks.
std::optional<SurfaceResult> runSurface(Device& device, const BodyModel& body, Capture& capture,
                                        const SurfaceRun& run);

// Poses of frames that training did not see, by the pictures of the avatar as it is: silhouettes,
// then colours too where `colours` is set. capture.betas are the avatar's.
void fitPosesToPictures(Device& device, const Avatar& avatar, Capture& capture, bool colours,
                        const LoopSettings& loop);

}  // namespace doppel
