// The frames of a long recording that tell most of the person.
#pragma once

#include <vector>

#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/data/shared_work.h"

namespace doppel {

// So many frames at most, ascending: all where the capture has no more. Half of them are taken
// evenly, for people show most what matters most, their faces; each of the others is the one whose
// pose and heading are farthest from those taken before (farthest-point sampling; Gonzalez,
// Clustering to Minimize the Maximum Intercluster Distance, 1985). Each may be one just before or
// behind it that shows as much and is sharper. Poses are looked at for all frames, pixels for three
// of each that is taken, of which each rank decodes its part; the mask of the one in the middle
// does for its neighbours, moved as the body is.
std::vector<size_t> tellingFrames(const Capture& capture, FrameCache& cache, size_t most,
                                  Ranks* ranks = nullptr);

}  // namespace doppel
