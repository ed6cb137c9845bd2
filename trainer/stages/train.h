// Training stages in their order, an avatar's folder growing as they finish.
#pragma once

#include <vector>

#include "trainer/stages/fit.h"
#include "trainer/stages/stage.h"

namespace doppel {

// Whether the avatar `there`, in settings.out, has all stages that are asked for already, from the
// same capture, body and numbers as `asked` has, so that nothing is left to do; false where it has
// none of them. InputError where it has some, or has them from something else: what to change.
bool isTrained(const Avatar& there, const Avatar& asked, const Capture& capture,
               Precision precision, const TrainSettings& settings);

// InputError that names the first of settings.stages which needs more than settings.memoryBudget,
// and how much; nothing where that is 0. Of the capture, numbers of frames and sizes count alone,
// and how large the person is in them; of the avatar, its preset has the texture's size
// (decideTextureSize).
void requireMemory(Device& device, const Avatar& avatar, const Capture& capture,
                   const TrainSettings& settings);

// Reads the capture's frames, trains, and leaves the avatar in settings.out. avatar: what is there
// already (its body, and networks of earlier stages). However often a run is stopped and resumed,
// it ends with the same bytes. InputError where an unfinished run was asked for something else,
// where another run is at work in settings.out, and where files there are not Doppel's own.
TrainResult trainAvatar(Device& device, Avatar avatar, Capture capture,
                        const TrainSettings& settings);

const std::vector<Stage>& allStages();  // in their order
std::vector<std::string> stageNames();
// Those of `asked` that the preset does not leave out, in their order.
std::vector<std::string> stagesOf(const Preset& preset, const std::vector<std::string>& asked);

}  // namespace doppel
