// Other programs' layouts brought into a capture.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "trainer/data/capture.h"
#include "trainer/import/importer.h"
#include "trainer/import/overlay.h"

namespace doppel {

struct ImportSettings {
    ImportRequest request;
    std::filesystem::path out;
    bool overlays = true;
    std::string commandLine;  // for provenance
};

struct ImportResult {
    Capture capture;  // as it is now on disk
    std::string layout;
    size_t givenMasks = 0, keyedMasks = 0;
    double meanIou = 0;  // of the given poses' silhouettes with the masks; 0 where there are none
};

// Reads the source with the importer that recognises it, and writes the capture settings.out with
// an overlay picture per frame (overlays/NAME.jpg) and a contact sheet (overlay.jpg); of a clip,
// mask and skeleton over its frames too (overlay.mp4). InputError for anything that is wrong with
// the source; nothing is left at settings.out then.
ImportResult importCapture(const ImportSettings& settings, const DrawBody& drawBody);

}  // namespace doppel
