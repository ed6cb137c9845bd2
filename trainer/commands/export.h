// `doppel export`.
#pragma once

#include <filesystem>
#include <string>

#include "trainer/commands/common_options.h"

namespace doppel {

struct ExportOptions {
    CommonOptions common;
    std::filesystem::path avatar, out, motion;  // motion may be empty
    std::string frames;
    std::string texture = "best";  // "baked", "coarse" or "best"
    std::string names = "smpl";    // jointNamesByWord
    bool shapes = false;
    std::string author, licence;
};

void runExport(const ExportOptions& options);

}  // namespace doppel
