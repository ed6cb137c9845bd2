// `doppel eval`.
#pragma once

#include <filesystem>
#include <string>

#include "trainer/commands/common_options.h"
#include "trainer/eval/measures.h"

namespace doppel {

struct EvalOptions {
    CommonOptions common;
    std::filesystem::path avatar, capture;  // one of each, or folders of them: see findCaptures
    std::string frames;
    std::string texture = "best";  // a word of textureKind()
    std::string fitTestPoses;  // "masks" or "pictures", what poses are fitted to; empty: as given
    bool givenPoses = false;   // of frames that were trained on: not the poses that training found
    std::filesystem::path pictures;  // a folder for render, frame and error side by side; empty: no
    std::filesystem::path out;       // a folder for tables; empty: none
    std::vector<std::string> regions;  // see atlasRegion()
    std::string scene = "frame";       // see EvaluateSettings::background
    MeasureOptions measures;
};

void runEval(const EvalOptions& options);

}  // namespace doppel
