// Poses a body and draws meshes, one frame at a time: what import, eval, render and the synthetic
// actor share. Each size of picture is recorded once and replayed.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "nn/body.h"
#include "nn/raster.h"
#include "trainer/capture.h"

namespace doppel {

// A body in a pose, in camera space, metres.
struct PosedMesh {
    std::vector<float> verts;                   // [V,3]
    std::vector<std::array<double, 3>> joints;  // [24]
};

class BodyPoser {
public:
    BodyPoser(Device& device, const BodyModel& body);
    PosedMesh pose(const Theta& theta, const Trans& trans, const Betas& betas);

private:
    Graph graph_;
    Tensor theta_, trans_, beta_, verts_, joints_;
};

struct Drawing {
    int width = 0, height = 0;
    std::vector<float> rgb;     // [H,W,3] sRGB-encoded, 0 where nothing is drawn
    std::vector<uint8_t> mask;  // [H,W] 255 where the mesh is seen
};

class MeshDrawer {
public:
    // The body's faces and atlas; the body outlives the drawer.
    MeshDrawer(Device& device, const BodyModel& body);
    ~MeshDrawer();

    std::vector<uint8_t> mask(std::span<const float> verts, const Camera& camera);
    // texture [size,size,3], sRGB-encoded in [0,1]. samples: per pixel and axis, averaged.
    Drawing draw(std::span<const float> verts, const Camera& camera, std::span<const float> texture,
                 int textureSize, int samples = 1);
    // A shaded picture without texture, lit from the camera: for overlays and previews.
    Drawing drawShaded(std::span<const float> verts, const Camera& camera);

private:
    struct Recording;
    Recording& recording(int width, int height, int textureSize);

    Device& device_;
    const BodyModel& body_;
    std::map<std::array<int, 3>, std::unique_ptr<Recording>> recordings_;
};

// The rasterizer's camera for a capture's.
RasterCamera rasterCamera(const Camera& camera, double sigma = 1e-5, double blurRadius = 9.21e-5);

}  // namespace doppel
