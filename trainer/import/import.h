// Other programs' layouts brought into a capture.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "trainer/commands/commands.h"
#include "trainer/data/capture.h"

namespace doppel {

// A body in a pose, as the camera sees it.
struct BodyPicture {
    std::vector<uint8_t> mask;  // [H][W], 255 where the body is, 0 elsewhere
    std::vector<float> shade;   // [H][W], how light it is there, [0,1]; may be empty
};
using DrawBody = std::function<BodyPicture(const Camera& camera, const Theta& theta,
                                           const Trans& trans, const Betas& betas)>;

struct ImportResult {
    Capture capture;  // as it is now on disk
    std::string layout;
    size_t givenMasks = 0, keyedMasks = 0;
    double meanIou = 0;  // of the given poses' silhouettes with the masks; 0 where there are none
};

// Reads options.source, whose layout it detects, and writes the capture options.out with an overlay
// picture per frame (overlays/NAME.jpg) and a contact sheet (overlay.jpg). Known layouts:
//
// - Human Retargeting (Gomes et al., IJCV 2021): images/*.jpg, smpl_pose/STEM*_body.pkl with pose,
//   trans, f, betas and openpose, and where given segmentations/STEM.png (> 0: the person).
// - Doppel's own captures (so that frames can be picked and masks keyed).
//
// InputError for anything that is wrong with the source; nothing is left at options.out then.
ImportResult importCapture(const ImportOptions& options, const DrawBody& drawBody);

}  // namespace doppel
