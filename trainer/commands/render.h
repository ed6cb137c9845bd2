// `doppel render`.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "trainer/commands/common_options.h"
#include "trainer/motion/retarget/retarget.h"

namespace doppel {

struct RenderOptions {
    CommonOptions common;
    std::filesystem::path avatar, motion, out;  // out: a folder for PNGs, or FILE.mp4
    std::string frames;
    std::string camera = "capture";      // "capture", "turntable", or a cameras.npz
    std::string background = "capture";  // "capture", or a colour "#rrggbb"
    std::string texture = "best";        // a word of textureKind()
    double smooth = 0;                   // frames; see smoothed()
    RetargetSettings retarget;
    int size = 0;    // pixels of the larger side; 0: the camera's
    double fps = 0;  // 0: the motion's
};

void runRender(const RenderOptions& options);

// Scale, contacts and figures of a motion that was changed, as `doppel retarget` says them too
// (retarget.cpp).
nlohmann::ordered_json retargetJson(const Retargeted& retargeted);

}  // namespace doppel
