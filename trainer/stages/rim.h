// The rim of a mask before a green or blue screen, where a person's pixels are mixed with what is
// behind: by the lens, by masks that are too wide, by light from the screen, and in files that keep
// colours coarsely (JPEG, H.264) for some pixels more.
#pragma once

#include <vector>

#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// The background's share in a pixel, by its distance from the outside: the outermost first.
struct RimProfile {
    std::vector<double> luma, chroma;  // 0 to kMostMixed
};
constexpr double kMostMixed = .8;

// Of `depth` pixels, measured over a capture's frames (16 at most): the share, by least squares, of
// the background beside a rim's pixels in their difference from the inside that is nearest. None
// where the person is not before a screen: what other backgrounds leave is of many colours and
// evens out. The frames need masks.
RimProfile measureRim(const Capture& capture, FrameCache& frames, int depth);

// The picture's colours [H,W,3] without that share.
std::vector<uint8_t> unmixed(const Picture& picture, const RimProfile& rim);

}  // namespace doppel
