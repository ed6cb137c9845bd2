#ifndef RASTER_PARAMS_H
#define RASTER_PARAMS_H
#include "common/camera.h"
#include "common/divide.h"
#include "common/shared.h"
SHARED_BEGIN
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
    Divisor byWidth;
};
struct TexturedRenderParams {
    uint pixels;
    uint textureWidth, textureHeight;
    uint sumStride;  // elements of a plane of the fixed-point sums, a multiple of 4
};
// See SeenSpans in nn/ops/raster.h.
struct SeenSpansParams {
    uint width, height;  // of the picture, pixels
    Divisor byWidth;
};
struct SampledRenderParams {
    uint width, height;
    uint textureWidth, textureHeight;
    Divisor byWidth;
};
struct VisibilityMapParams {
    uint faces, size;
    uint largeBox;
};
// See SurfaceRender in nn/ops/surface.h.
struct SurfaceParams {
    uint width, height;  // of the picture, pixels
    uint textureWidth, textureHeight;
    float edgeJump;   // m
    Divisor byWidth;  // of a line of samples
};
struct SurfaceGradientParams {
    uint faces, vertices;
    uint width, height;  // of the samples
    uint largeBox;       // a face whose box holds more samples is shared by a workgroup
};
const uint kSpan = 16;  // neighbouring pixels, in reading order, that are shaded together
SHARED_END
#endif
