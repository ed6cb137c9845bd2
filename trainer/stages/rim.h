// The rim of a mask before a green or blue screen, where a person's pixels are mixed with what is
// behind: by the lens, by masks that are too wide, by light from the screen, and in files that keep
// colours coarsely (JPEG, H.264) for some pixels more.
#pragma once

#include <vector>

#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/data/shared_work.h"

namespace doppel {

// `rim` where a capture's frames (16 are looked at, of which each rank decodes its part) are before
// such a screen, else 0: what other backgrounds leave is of many colours, and evens out.
int rimBeforeScreen(const Capture& capture, FrameCache& frames, int rim, Ranks* ranks = nullptr);

// A picture's colours [H,W,3] in which a mask's outermost `rim` pixels, and so many `beyond` them,
// are the mean of the nearest that is further inside, or in thin parts of what is furthest inside.
std::vector<uint8_t> withoutRim(const Picture& picture, int rim, int beyond = 0);

}  // namespace doppel
