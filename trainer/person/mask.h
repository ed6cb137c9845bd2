// Masks of people, from the network's square to the picture's own edges.
#pragma once

#include <cstdint>
#include <vector>

#include "trainer/person/blazepose.h"

namespace doppel {

// How surely each pixel [H,W] is the person's, [0, 1]: the mask of the square, turned back; 0
// outside of it.
std::vector<float> personShare(const PersonLandmarks& person, int width, int height);

// [H,W], 255 on the person and 0 elsewhere: where the share, after it was led along the picture's
// edges (He, Sun and Tang, Guided Image Filtering, TPAMI 2013), is at least a half. Islands far
// smaller than the person are left out.
std::vector<uint8_t> personMask(const PersonLandmarks& person, const Image& rgb);

// A mean [H,W] of `share`, by local linear models of the picture's colours: of windows of 2 radius
// + 1 pixels a side; epsilon: the variance of colours in [0, 1] below which a window is flat.
std::vector<float> guidedFilter(const Image& rgb, const std::vector<float>& share, int radius,
                                double epsilon);

}  // namespace doppel
