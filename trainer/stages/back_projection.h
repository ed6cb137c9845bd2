// A first texture straight from the frames: what each texel's place on the body shows in the frames
// that see it.
#pragma once

#include <vector>

#include "engine/device.h"
#include "nn/body/body.h"
#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// [size,size,3] in [0,1]: the mean over the frames (120 at most) of the pixel at each texel's
// place, weighted by the fourth power of the cosine to the camera, and by a hundredth for each of
// the two outermost pixels of a mask that it lies in. A place counts where no other part of the
// body is before it. Texels that no frame sees take the mean of their neighbours. The frames need
// masks.
std::vector<float> backProject(Device& device, const BodyModel& body, const Capture& capture,
                               FrameCache& frames, int size);

}  // namespace doppel
