// `doppel import`.
#pragma once

#include <string>

#include "trainer/commands/common_options.h"
#include "trainer/import/import.h"

namespace doppel {

struct ImportOptions {
    CommonOptions common;
    ImportSettings settings;
    std::string net = "heavy";  // poseNetByName
    std::string body;           // "default", "default-full" or a file
};

void runImport(const ImportOptions& options);

}  // namespace doppel
