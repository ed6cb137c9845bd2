// `doppel demo`.
#pragma once

#include <filesystem>
#include <string>

#include "trainer/avatar/preset.h"
#include "trainer/commands/common_options.h"

namespace doppel {

struct DemoOptions {
    CommonOptions common;
    std::filesystem::path out = "out/demo";
    std::string actor = "woman";  // one of actorNames() of assets/actor, or an .npz
    int size = 512;               // of the recording's frames, pixels
    double clip = 0;              // seconds of a clip to write instead; 0: the whole job
    bool still = false;
    bool record = false;  // the recording alone
    bool lamp = false;    // the actor stands under studioLamp()
    Preset preset;
};

void runDemo(const DemoOptions& options);

}  // namespace doppel
