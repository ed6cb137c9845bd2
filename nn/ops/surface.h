// A surface drawn over a background so that a picture's loss moves it: colours and outlines.
#pragma once

#include "nn/ops/raster.h"

namespace doppel {

// The mean of samples x samples samples per pixel.
struct SurfaceRender {
    Tensor image;  // [H,W,3] the surface's colours over the background; empty without colours
    Tensor alpha;  // [H,W] the part of the samples at which the surface is seen
};

struct SurfaceLook {
    RasterAtlas atlas;
    Tensor texture;     // [Ht,Wt,3]
    Tensor background;  // [H,W,3]
    // [H,W] The part of a pixel's gradient that reaches the texture; empty: all of it. Where a
    // picture shows the background, that the surface is there is wrong, and not its colour.
    Tensor teaches = {};
    // [V,4] With what power, 0 or more, of the cosine between a normal and the way to the camera a
    // sample's gradient reaches the texture: x, y, z of the normal (outwards, of any length; zeros:
    // that of the face), the power; linear within a face. Empty: all of it does.
    Tensor facing = {};
};

struct SurfaceOptions {
    int64_t samples = 1;  // per pixel and axis
    // Neighbouring samples whose depths differ by more (m) have an edge of the nearer surface
    // between them.
    float edgeJump = 0.03f;
    RasterOptions raster = {};
};

// Draws the mesh with a look, or its alpha alone without one. verts [V,3]; camera: as of a picture
// of samples x height by samples x width pixels. Gradients to verts, texture and not to the
// background: inside a face as texture and perspective have it, across edges as
// shaders/raster/surface_force.comp says. The values are those of hard samples, so a coverage has
// no width to choose and its loss no bias.
SurfaceRender surfaceRender(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                            const Tensor& camera, const SurfaceLook* look, int64_t height,
                            int64_t width, const SurfaceOptions& options = {});

}  // namespace doppel
