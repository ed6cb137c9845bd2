// `doppel export`.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "engine/io/vrm/vrm.h"
#include "trainer/commands/common_options.h"
#include "trainer/motion/retarget/retarget.h"

namespace doppel {

struct ExportOptions {
    CommonOptions common;
    std::filesystem::path avatar;
    // A file, a folder of a page, or one of networks; one of the three.
    std::filesystem::path out, web, networks;
    std::vector<std::filesystem::path> motions;  // several become several animations
    std::string frames;
    RetargetSettings retarget;
    std::string texture = "best";  // "baked", "coarse" or "best"
    std::string names = "smpl";    // jointNamesByWord
    bool shapes = false;
    std::string author, licence, material = "unlit";
    VrmPermissions permissions;
    std::vector<std::string> allowed;  // of a VRM's questions: "violence"
};

void runExport(const ExportOptions& options);

}  // namespace doppel
