// Square parts of frames, as training sees them.
#pragma once

#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "trainer/data/camera.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// A square in a picture, in its pixels; it may reach beyond the border.
struct CropBox {
    double centreX = 0, centreY = 0, half = 0;
};

// The square around the pelvis in which the body fills the picture: half size 1.1 × the largest
// projected distance of a joint from the pelvis. joints: [24], camera space, metres, all with
// positive z (InputError otherwise: `where` names the frame).
CropBox cropBox(const Camera& camera, std::span<const std::array<double, 3>> joints,
                std::string_view where = "frame");

// The camera that draws the box with size × size pixels: u' = (u − left) · size / (2 half).
Camera cropCamera(const Camera& camera, const CropBox& box, int size);

struct Crop {
    Camera camera;              // S × S
    std::vector<float> image;   // [S][S][3], sRGB-encoded, [0,1]; 0 outside the frame; empty as rgb
    std::vector<float> mask;    // [S][S], [0,1]; empty where the picture has none
    std::vector<float> inside;  // [S][S], the part of each pixel that lies inside the frame
};

// Each pixel is the mean of the frame over its square where the box shrinks the frame, and a
// bilinear sample at its centre where it enlarges it.
Crop crop(const Picture& picture, const Camera& camera, const CropBox& box, int size);

}  // namespace doppel
