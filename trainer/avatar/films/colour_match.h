// An avatar's colours, learnt in one light, brought towards those of the place that it is put into.
#pragma once

#include <array>
#include <vector>

#include "trainer/data/body_render.h"

namespace doppel {

// Goes through a film's pictures in their order: what is found is averaged over about ten pictures,
// so that colours do not flicker.
class ColourMatch {
public:
    // background [H,W,3]. What is around the avatar, as high and wide as it to each side, says:
    // the light's tint, as its mean differs from grey; how bright and how rich in contrast it is
    // there, against the avatar. Each moves the avatar's colours by a part of the way, and by at
    // most 15 to 25 in a hundred. Coverage stays as it is.
    void apply(Drawing& drawing, const std::vector<float>& background);

    // Of the last picture: what each channel was multiplied by, and the contrast.
    const std::array<float, 3>& gain() const { return gain_; }
    float contrast() const { return contrast_; }

private:
    bool begun_ = false;
    std::array<float, 3> gain_{1, 1, 1};
    float contrast_ = 1;
};

}  // namespace doppel
