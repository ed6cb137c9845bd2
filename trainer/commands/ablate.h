// `doppel ablate`.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "trainer/avatar/preset.h"
#include "trainer/commands/common_options.h"
#include "trainer/eval/measures.h"

namespace doppel {

struct AblateOptions {
    CommonOptions common;
    std::filesystem::path capture, out;
    std::string body, frames, testFrames;  // testFrames: empty: those of the training
    bool fitTestPoses = false;
    std::vector<std::string> variants;  // some of ablationVariants(); empty: all
    Preset preset;
    std::filesystem::path pictures;  // as in EvalOptions, a folder per variant in it
    std::string scene = "frame";
    MeasureOptions measures;
    uint64_t memoryBudget = 0;
};

// "no-refine", "no-clamp", "complete", "no-gan", "no-face".
const std::vector<std::string>& ablationVariants();

void runAblate(const AblateOptions& options);

}  // namespace doppel
