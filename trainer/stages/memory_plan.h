// Whether a run fits into the memory that it may use, before it begins.
#pragma once

#include "trainer/stages/stage.h"

namespace doppel {

// Plans the steps of all stages of settings.stages with fresh networks. InputError that names the
// first stage which needs more than settings.memoryBudget, and how much; nothing where that is 0.
void requireMemory(Device& device, const Avatar& avatar, const Capture& capture,
                   const TrainSettings& settings);

}  // namespace doppel
