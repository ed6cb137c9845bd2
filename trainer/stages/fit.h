// Stage "fit": shape, poses and positions refined by gradient descent through LBS and the soft
// silhouette (and keypoints where the capture has them).
#pragma once

#include <initializer_list>
#include <vector>

#include "engine/device.h"
#include "nn/body/body.h"
#include "trainer/avatar/preset.h"
#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/stages/stage.h"

namespace doppel {

struct FitSettings {
    FitPreset preset;
    bool fitShape = true;       // false: betas stay as they are (a known person in new frames)
    LoopSettings loop = {};     // its seed; with a folder, curves and checkpoints go there
    uint64_t memoryBudget = 0;  // see CompileOptions
};

// Whether frames follow each other closely enough to tell about each other: views from all sides do
// not, nor do frames that were chosen for being unlike each other (capture.source says "chosen").
// Rotations have been unwrapped.
bool isVideo(const Capture& capture);

// Where each frame's keypoints want each joint, [24,3]: u, v in the frame's pixels and confidence.
// The head's is where its face wants it, as the poses have it turned. Nothing without keypoints.
std::vector<std::vector<float>> jointTargets(const BodyModel& body, const Capture& capture);

// Replaces capture.betas, theta and trans. Every frame needs a mask (InputError otherwise). Where
// capture.source says "heads" (they were found by themselves), heads go on looking where they look.
// Interrupted is thrown with nothing changed but what settings.loop keeps.
FitResult fitCapture(Device& device, const BodyModel& body, Capture& capture,
                     const FitSettings& settings);

// Fits the shape as stage "fit" did, once more, now that the avatar's offsets say what clothes add:
// to outlines alone, clothes were girth. Limbs stay as they were fitted, or what outlines leave
// open, as how a head leans, would go as far once more.
void fitBelowClothes(Device& device, TrainResult& result, const TrainSettings& settings);

// IoU with each frame's mask, at the frame's resolution, of the body as each of `posed` poses it:
// captures of the same frames, whose masks are decoded once. [posed][frame]. Each rank looks at its
// part of the frames.
std::vector<std::vector<double>> silhouetteIous(Device& device, const BodyModel& body,
                                                std::initializer_list<const Capture*> posed,
                                                FrameCache& frames, Ranks* ranks = nullptr);

// The same of a capture before and after a fit.
FitResult fitResult(Device& device, const BodyModel& body, const Capture& before,
                    const Capture& after, FrameCache& frames, Ranks* ranks = nullptr);

}  // namespace doppel
