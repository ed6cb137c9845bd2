// Another program's poses in the place of a capture's own.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/import/overlay.h"
#include "trainer/motion/estimates/estimate.h"

namespace doppel {

struct GivenPosesRequest {
    std::filesystem::path poses;      // of readEstimates
    std::filesystem::path source;     // of the capture: a video, a folder of pictures, another one
    std::filesystem::path workspace;  // where pictures and masks of frames lie that are left out
};

// What was found in the file, for people to read.
struct GivenPoses {
    std::string told;       // "VIBE, person 2 of 3 people, boxes as they are"
    std::string filled;     // "4 between their neighbours, frames left out, …: 2"; empty: nothing
    bool measured = false;  // Estimates::measured
};

// Puts the poses and cameras of a file into the capture, whose frames they are matched to by the
// pictures' names (where both have some) or by their numbers in the clip. Up to a dozen pictures
// without a pose are filled from their neighbours'; frames that lack one after that are left out.
//
// Masks decide what the file leaves open: which of the people it is, picture by picture, and which
// of the ways to read the file draws the body there; and how far from the camera our body, which is
// of another size than the program's, fills them as high. Without masks it is the person with most
// poses, and the most likely reading.
//
// InputError: the file's (readEstimates), no frame that has a pose, and a body that misses the
// masks however the file is read.
GivenPoses takeGivenPoses(Capture& capture, const GivenPosesRequest& request,
                          const DrawBody& drawBody);

// Adds how well the given poses cover the masks to a clip's quality.json, where there is one:
// pose_iou, of each frame and in the mean. overlaps: IoU of each frame.
void notePoseOverlaps(const std::filesystem::path& workspace, const Capture& capture,
                      std::span<const double> overlaps);

}  // namespace doppel
