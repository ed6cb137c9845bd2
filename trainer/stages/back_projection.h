// A first texture straight from the frames: what each texel's place on the body shows in the frames
// that see it.
#pragma once

#include <vector>

#include "engine/device.h"
#include "nn/body/body.h"
#include "trainer/avatar/bake.h"
#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/data/shared_work.h"
#include "trainer/stages/prior/people.h"

namespace doppel {

struct FirstTexels {
    std::vector<float> texture;   // [size,size,3] in [0,1]
    std::vector<uint8_t> origin;  // [size,size] TexelOrigin
    std::vector<double> trust;    // [size,size] how well frames see a texel: weights, summed
    std::vector<float> heights;   // [V] m, of what is worn, as known people tell; empty without
    // The parts of the atlas's texels that have this origin, 0 to 1.
    double part(TexelOrigin from) const;
};

// As many frames are looked at, evenly taken: more would hardly change a mean.
inline constexpr size_t kProjectedFrames = 120;

// Texels that frames show have the mean over the frames (kProjectedFrames at most) of the pixel at
// each texel's place, weighted by the fourth power of the cosine to the camera, by a hundredth in
// the two outermost pixels of a mask (before a screen in the `rim` outermost) and by a hundredth of
// that on its border. The border, before a screen all the rim, has the colours of what is further
// inside (rim.h). A place counts where no other part of the body is before it, and where it is not
// seen from its side. A texel that no frame sees takes its mirror image on the body's other side
// where a frame sees that, or what is within 15 mm of it, else what lies around it on the body
// (colours/unseen_colours.h) and what known people tell (prior/expected_look.h). The frames need
// masks. Each rank looks at its part of the frames; all get the same, which differs from one
// process's by rounding.
FirstTexels backProject(Device& device, const BodyModel& body, const Capture& capture,
                        FrameCache& frames, int size, int rim, Ranks* ranks = nullptr,
                        const KnownPeople& known = {});

// Gives texels that no frame sees what those tell that frames do see, in the place of what they
// have: for texels that were trained since. A mirror image is within two texels here: farther, it
// would repeat the rim of what is seen.
void fillUnseen(const BodyModel& body, int size, const KnownPeople& known, FirstTexels& first);

}  // namespace doppel
