// The camera of the rasterizers and of the keypoint loss.
#ifndef COMMON_CAMERA_H
#define COMMON_CAMERA_H
#include "common/shared.h"
SHARED_BEGIN
// Pinhole: u = fx x/z + cx, v = fy y/z + cy, in pixels; camera space is x right, y down, z forward.
// A tensor, not push constants: each frame has its own crop, and sigma may be annealed.
struct RasterCamera {
    float fx, fy, cx, cy;
    float sigma;       // of the soft silhouette, squared NDC distance (the shorter side spans 2)
    float blurRadius;  // likewise
    float reserved0, reserved1;
};
// What is nearer than this (m), or behind, is left out.
const float kNear = 1e-3f;
SHARED_END
#endif
