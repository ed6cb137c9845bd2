#ifndef RASTER_PARAMS_H
#define RASTER_PARAMS_H
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
struct ProjectParams {
    uint vertices;
    float centreX, centreY;  // of the picture, in pixels: what screen positions are relative to
};
struct SoftSilhouetteParams {
    uint faces, width, height;
    uint largeBox;  // a face whose box holds more pixels is shared by a workgroup
};
struct VisibilityParams {
    uint faces, width, height;
    uint largeBox;
    uint pass;  // 0: nearest depth; 1: lowest face at that depth
};
struct TexturedRenderParams {
    uint pixels;
    uint textureWidth, textureHeight;
    uint sumStride;  // elements of a plane of the fixed-point sums, a multiple of 4
};
struct VisibilityMapParams {
    uint faces, size;
    uint largeBox;
};
SHARED_END
#endif
