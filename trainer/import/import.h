// Other programs' layouts brought into a capture.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "trainer/data/capture.h"
#include "trainer/import/importer.h"
#include "trainer/import/overlay.h"

namespace doppel {

struct ImportSettings {
    ImportRequest request;
    std::filesystem::path out;
    bool overlays = true;
    std::string commandLine;  // for provenance
    // All that the capture depends on, for imports that go on where a run that was stopped was;
    // empty: they start over.
    std::string work;
    bool startsOver = false;  // also where such a run has left something
};

struct ImportResult {
    Capture capture;  // as it is now on disk
    std::string layout;
    size_t givenMasks = 0, keyedMasks = 0;
    double meanIou = 0;  // of the given poses' silhouettes with the masks; 0 where there are none
    std::vector<double> iou;         // of each frame; empty where a frame has no mask
    std::string poses, posesFilled;  // what was found of request.poses (GivenPoses)
};

// Reads the source with the importer that recognises it, and writes the capture settings.out with
// an overlay picture per frame (overlays/NAME.jpg) and a contact sheet (overlay.jpg); of a clip,
// mask and skeleton over its frames too (overlay.mp4). InputError for anything that is wrong with
// the source; nothing is left at settings.out then. Interrupted: a clip's frames that were looked
// at are left in a hidden folder beside it, and taken from there by the next run of the same work.
ImportResult importCapture(const ImportSettings& settings, const DrawBody& drawBody);

}  // namespace doppel
