// Where a body is on a picture.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>

#include "trainer/data/camera.h"
#include "viewer/picture/view_transform.h"
#include "viewer/window/canvas.h"

namespace doppel {

// Where vertices are on a picture, pixels; everywhere where one of them is behind the camera.
struct Bounds {
    double left = INFINITY, right = -INFINITY, top = INFINITY, bottom = -INFINITY;

    void add(const float* vertex, const Camera& camera, const ViewTransform& view);
};

// Of all vertices [V,3].
Bounds boundsOf(std::span<const float> verts, const Camera& camera, const ViewTransform& view);
// Of the faces with a vertex that is not where it was, before and now; rings: 2 takes the faces
// next to those along.
Bounds boundsOfMoved(std::span<const float> before, std::span<const float> now,
                     std::span<const int32_t> faces, int rings, const Camera& camera,
                     const ViewTransform& view);

// The pixels that the bounds touch, grown to a grid so that few sizes occur.
PixelBox around(const Bounds& bounds, const Camera& camera);

}  // namespace doppel
