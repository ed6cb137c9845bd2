// Training stages in their order, an avatar's folder growing as they finish.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "trainer/data/capture.h"
#include "trainer/stages/fit.h"

namespace doppel {

// resume: go on with the unfinished run in `out`, which must have been asked for the same;
// otherwise what is left of one is removed, and finished stages are trained again.
struct TrainSettings : LoopSettings {
    // Called once the run's folder holds a first state in liveFolder(); may be empty, and then that
    // comes with the first picture.
    std::function<void()> opened;
    std::vector<std::string> stages{"fit", "mesh", "texture"};  // in this order
    uint64_t memoryBudget = 0;

    CompileOptions compileOptions() const {
        return {.memoryBudget = memoryBudget, .timestamps = profileSteps > 0};
    }
};

struct TrainResult {
    Avatar avatar;
    Capture capture;  // with the fitted poses
    std::optional<FitResult> fit;
};

// Whether the avatar `there`, in settings.out, has all stages that are asked for already, from the
// same capture, body and numbers as `asked` has, so that nothing is left to do; false where it has
// none of them. InputError where it has some, or has them from something else: what to change.
bool isTrained(const Avatar& there, const Avatar& asked, const Capture& capture,
               Precision precision, const TrainSettings& settings);

// Reads the capture's frames, trains, and leaves the avatar in settings.out. avatar: what is there
// already (its body, and networks of earlier stages). However often a run is stopped and resumed,
// it ends with the same bytes. InputError where an unfinished run was asked for something else,
// where another run is at work in settings.out, and where files there are not Doppel's own.
TrainResult trainAvatar(Device& device, Avatar avatar, Capture capture,
                        const TrainSettings& settings);

// Stage "fit": the capture's poses and shape; see fitCapture().
void trainFit(Device& device, TrainResult& result, const TrainSettings& settings);

// Stage 1: the mesh refinement network G_m against the masks; fills avatar.meshNet.
void trainMesh(Device& device, TrainResult& result, const TrainSettings& settings);

// Stage 2: the coarse texture network G_TN against the frames; fills avatar.textureNet and texture.
void trainTexture(Device& device, TrainResult& result, const TrainSettings& settings);

// Stage 3: the texture refinement network G_RN; fills avatar.refineNet and bakedTexture. InputError
// where the avatar has no texture network.
void trainRefine(Device& device, TrainResult& result, const TrainSettings& settings);

// A stage, as a run takes them one after the other.
struct Stage {
    const char* name;
    void (*train)(Device&, TrainResult&, const TrainSettings&);
    // Takes what an earlier training of the stage made, and what stands on it, off the avatar.
    void (*clear)(Avatar&);
    bool movesPoses = false;  // it changes the capture's poses, which the stages after it need
};
const std::vector<Stage>& allStages();  // in their order

}  // namespace doppel
