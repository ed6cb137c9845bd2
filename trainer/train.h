// Training stages in their order, an avatar's folder growing as they finish.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "trainer/avatar.h"
#include "trainer/capture.h"
#include "trainer/stage_fit.h"

namespace doppel {

struct TrainSettings {
    std::vector<std::string> stages{"fit", "mesh", "texture"};  // in this order
    std::filesystem::path out;
    uint64_t seed = 1;
    bool resume = false;
    double pictureSeconds = 60;
    uint64_t memoryBudget = 0;
    int profileSteps =
        0;  // > 0: run so many steps of each stage, print the time per op, keep nothing
};

struct TrainResult {
    Avatar avatar;
    Capture capture;  // with the fitted poses
    std::optional<FitResult> fit;
};

// Reads the capture's frames, trains, and leaves the avatar in settings.out. avatar: what is there
// already (its body, and networks of earlier stages).
TrainResult trainAvatar(Device& device, Avatar avatar, Capture capture,
                        const TrainSettings& settings);

// Stage 1: the mesh refinement network G_m against the masks; fills avatar.meshNet.
void trainMesh(Device& device, Avatar& avatar, const Capture& capture,
               const TrainSettings& settings);

// Stage 2: the coarse texture network G_TN against the frames; fills avatar.textureNet and texture.
void trainTexture(Device& device, Avatar& avatar, const Capture& capture,
                  const TrainSettings& settings);

}  // namespace doppel
