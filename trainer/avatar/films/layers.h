// What a drawing of the avatar is put together with: what is behind it, below it and in front of
// it.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "engine/io/image.h"
#include "trainer/avatar/films/contact_shadow.h"
#include "trainer/data/body_render.h"

namespace doppel {

// Of each shot of a render, by its number.
struct Layers {
    // [H,W,3], sRGB-encoded in [0,1]. Null: nothing is behind, and pictures keep alpha.
    std::function<std::vector<float>(size_t)> background;
    // [H,W] in [0,1]: how much is in front of the avatar and its shadow. Null: nothing.
    std::function<std::vector<float>(size_t)> occluder = {};
    // Where each shot's shadow falls (groundsOf); empty: there is none.
    std::vector<Ground> grounds = {};
    bool matchColours = false;  // to the background (colour_match.h)
    int samples = 2;            // of the drawing, per pixel and axis
};

// Darkens what is behind the avatar by shadow [H,W], of which 1 is black, by covering it.
void addShadow(Drawing& drawing, const std::vector<float>& shadow);

// Takes what is hidden, [H,W] in [0,1], out of the avatar's colours and coverage.
void occlude(Drawing& drawing, const std::vector<float>& hidden);

// The drawing as a picture of 4 channels with straight alpha: over any colour it gives what
// composite() gives, to the rounding of 8 bits. bleed: what nothing covers has the colours that
// are next to it, since films keep colours for several pixels; else it is black.
Image straightAlpha(const Drawing& drawing, bool bleed);

}  // namespace doppel
