// A stage of the training: what it is given, and what a run knows of it.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "trainer/data/capture.h"
#include "trainer/stages/prior/people.h"
#include "trainer/stages/stage_loop.h"

namespace doppel {

// resume: go on with the unfinished run in `out`, which must have been asked for the same;
// otherwise what is left of one is removed, and finished stages are trained again.
struct TrainSettings : LoopSettings {
    // Called once the run's folder holds a first state in liveFolder(); may be empty, and then that
    // comes with the first picture.
    std::function<void()> opened;
    std::vector<std::string> stages{"fit", "mesh", "texture"};  // in this order
    uint64_t memoryBudget = 0;
    KnownPeople known;  // who tell what frames do not show; of nobody: the frames alone do

    // sharing: the ranks that share the stage's batches (LoopSettings::sharing()).
    CompileOptions compileOptions(Ranks* sharing = nullptr) const {
        return {.memoryBudget = memoryBudget, .timestamps = profileSteps > 0, .ranks = sharing};
    }
};

struct FitResult {
    // Of the body's silhouette with the masks, at the frames' own resolution, mean over frames.
    double iouBefore = 0, iouAfter = 0;
    std::vector<double> frameIouBefore, frameIouAfter;
};

struct TrainResult {
    Avatar avatar;
    Capture capture;  // with the fitted poses
    std::optional<FitResult> fit;
};

// Each stage trains, and plans: it compiles its step for fresh networks and lets it go again, which
// is an InputError where that needs more than settings.memoryBudget.

// Stage "fit": the capture's poses and shape; see fitCapture().
void trainFit(Device& device, TrainResult& result, const TrainSettings& settings);
void planFit(Device& device, const Avatar& avatar, const Capture& capture,
             const TrainSettings& settings);

// Stage "caps": hair and loose cloth beyond the body; see growCap() in caps/caps.h. Gives the
// avatar's body more vertices and faces.
void trainCaps(Device& device, TrainResult& result, const TrainSettings& settings);
void planCaps(Device& device, const Avatar& avatar, const Capture& capture,
              const TrainSettings& settings);

// Stages "shape" and "texels": the body's own offsets from silhouettes; then its texels, offsets
// and the poses from silhouettes and colours. Both move the capture's poses.
void trainShape(Device& device, TrainResult& result, const TrainSettings& settings);
void trainTexels(Device& device, TrainResult& result, const TrainSettings& settings);
void planShape(Device& device, const Avatar& avatar, const Capture& capture,
               const TrainSettings& settings);
void planTexels(Device& device, const Avatar& avatar, const Capture& capture,
                const TrainSettings& settings);

// For plans of later stages: the avatar's light, or one of zeros where stage "texels" will learn
// it.
std::vector<float> plannedLight(const Avatar& avatar, const TrainSettings& settings);

// Stage 1: the mesh refinement network G_m against the masks; fills avatar.meshNet.
void trainMesh(Device& device, TrainResult& result, const TrainSettings& settings);
void planMesh(Device& device, const Avatar& avatar, const Capture& capture,
              const TrainSettings& settings);

// Stage 2: the coarse texture network G_TN against the frames; fills avatar.textureNet and texture.
void trainTexture(Device& device, TrainResult& result, const TrainSettings& settings);
void planTexture(Device& device, const Avatar& avatar, const Capture& capture,
                 const TrainSettings& settings);

// Stage 3: the texture refinement network G_RN; fills avatar.refineNet and bakedTexture. InputError
// where the avatar has no texture network, unless the run is a profile, which takes a fresh one.
void trainRefine(Device& device, TrainResult& result, const TrainSettings& settings);
void planRefine(Device& device, const Avatar& avatar, const Capture& capture,
                const TrainSettings& settings);

// A stage, as a run takes them one after the other.
struct Stage {
    std::string name;
    void (*train)(Device&, TrainResult&, const TrainSettings&);
    void (*plan)(Device&, const Avatar&, const Capture&, const TrainSettings&);
    // Whether the preset leaves it out, as the paper does; empty: never.
    bool (*isLeftOut)(const Preset&) = nullptr;
    bool movesPoses = false;  // it changes the capture's poses, which the stages after it need
    bool optional = false;    // an avatar is whole without it
    // Of what the stage leaves in an avatar beside its record; empty: nothing. Whether it is there;
    // and taking it off, with what later stages made of it.
    bool (*isIn)(const Avatar&) = nullptr;
    void (*clear)(Avatar&) = nullptr;
};

}  // namespace doppel
