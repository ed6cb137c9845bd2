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
    std::filesystem::path avatar, motion, out;  // out: a folder for PNGs, or a film
    std::string frames;
    std::string camera = "capture";  // "capture", "turntable", or a cameras.npz
    // "capture", "none", a colour "#rrggbb", or a picture, a film or a folder of pictures.
    std::string background = "capture";
    std::filesystem::path occluder;  // masks of what is in front: as the background; empty: nothing
    bool shadow = false, matchColours = false;
    std::string audio = "source";   // "source", "none", or a file that has sound
    std::string texture = "best";   // a word of textureKind()
    std::string light = "capture";  // or "none"
    double smooth = 0;              // frames; see smoothed()
    RetargetSettings retarget;
    int size = 0;     // pixels of the larger side; 0: the camera's
    int samples = 2;  // per pixel and axis
    double fps = 0;   // 0: the motion's
};

void runRender(const RenderOptions& options);

// Scale, contacts and figures of a motion that was changed, as `doppel retarget` says them too
// (retarget.cpp).
nlohmann::ordered_json retargetJson(const Retargeted& retargeted);

}  // namespace doppel
