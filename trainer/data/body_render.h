// Poses a body and draws meshes, one frame at a time: what import, eval, render and the synthetic
// actor share. Each size of picture is recorded once and replayed.
#pragma once

#include <array>
#include <deque>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "nn/ops/raster.h"
#include "trainer/data/camera.h"

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
    // The body's faces and atlas; the body outlives the drawer. light: L [8,3] (nn/steps/light.h),
    // under which textures are drawn; empty: as they are.
    MeshDrawer(Device& device, const BodyModel& body, std::vector<float> light = {});
    ~MeshDrawer();

    std::vector<uint8_t> mask(std::span<const float> verts, const Camera& camera);
    // texture [size,size,3], sRGB-encoded in [0,1]. samples: per pixel and axis, averaged.
    Drawing draw(std::span<const float> verts, const Camera& camera, std::span<const float> texture,
                 int textureSize, int samples = 1);
    // A shaded picture without texture, lit from the camera: for overlays and previews.
    Drawing drawShaded(std::span<const float> verts, const Camera& camera);

    // draw() in two halves, of a mesh and a texture that are on the device already: graphs that are
    // submitted before submit() may write them. Two pictures at most are under way.
    BufferView verts();                   // [V,3]
    BufferView texture(int textureSize);  // [size,size,3]
    void submit(const Camera& camera, int textureSize, int samples);
    Drawing take();  // the oldest that was submitted

private:
    struct Silhouette;
    struct Picture;

    Silhouette& silhouette(int width, int height);

    Device& device_;
    const BodyModel& body_;
    std::vector<float> light_;
    Buffer verts_;
    std::map<int, Buffer> textures_;                                         // by size
    std::map<std::array<int, 2>, std::unique_ptr<Silhouette>> silhouettes_;  // width, height
    std::map<std::array<int, 4>, std::unique_ptr<Picture>> pictures_;        // and texture, samples
    std::deque<Picture*> underWay_;
};

// The rasterizer's camera for a capture's.
RasterCamera rasterCamera(const Camera& camera, double sigma = 1e-5, double blurRadius = 9.21e-5);

}  // namespace doppel
