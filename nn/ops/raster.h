// Rasterizers: soft silhouette, visibility buffer, textured render, visibility map.
//
// Camera space: x right, y down, z forward, m. Pictures: row 0 on top, pixel centres at a half. No
// limit on faces per pixel and nothing dropped: each face walks over the pixels of its own box and
// meets the others in integer atomics only, so the same input gives the same bits, in whatever
// order the device takes the faces. A face with a vertex at z <= 0.001 m is skipped.
#pragma once

#include <span>

#include "nn/core/graph.h"
#include "nn/ops/raster_camera.h"
#include "raster/params.h"

namespace doppel {

// A mesh's faces on the device; made once per graph and used by any number of renders.
struct RasterMesh {
    int64_t vertices = 0, faces = 0;
    Tensor faceVertices;  // [F,4] v0, v1, v2, 0; one row of zeros where there are no faces
    Tensor cornerStart;   // [V+1] where a vertex's corners start in
    Tensor corners;       // [3F] face*3 + corner, by vertex
};
// faces: three vertices each. InputError, naming `what`, where a number is not below `vertices`.
RasterMesh rasterMesh(Graph& graph, std::span<const int32_t> faces, int64_t vertices,
                      std::string_view what = "faces");

// Where the faces' corners lie in a texture; faces in the same order as the mesh's.
struct RasterAtlas {
    Tensor uvs;          // [T,2] glTF's: (0,0) is the texture's top left corner
    Tensor faceCorners;  // [F,4] t0, t1, t2, 0
};
RasterAtlas rasterAtlas(Graph& graph, const Tensor& uvs, std::span<const int32_t> facesUv,
                        std::string_view what = "faces_uv");

struct RasterOptions {
    // A face whose box holds more pixels than this is shared by the invocations of a workgroup;
    // smaller ones take one invocation each. The picture is the same.
    uint32_t largeBox = 1024;
};

// Î_s = Π_s(M), silhouette[H,W] = 1 - prod over faces of (1 - sigmoid(+-d^2 / sigma)): d the
// distance from the pixel's centre to the face's boundary in NDC (the picture's shorter side spans
// 2), + inside; over all faces that cover the pixel or have d^2 < blurRadius. Faces of |2 area| <=
// 1e-8 NDC^2 count for nothing. verts [V,3]. Gradient to verts; which faces count, inside or
// outside, and which edge is nearest are constants of it.
Tensor softSilhouette(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                      const Tensor& camera, int64_t height, int64_t width,
                      const RasterOptions& options = {});

// What is seen at each pixel's centre: the nearest face, edges included, both sides; of two at the
// same depth the one with the lower number. No gradients.
struct VisibilityBuffer {
    Tensor faceIndex;  // [H,W] int32; -1: none
    Tensor mask;       // [H,W] 1 where a face is seen, 0 elsewhere
    Tensor surface;    // [H,W,4] perspective-correct barycentrics and depth (m); zeros: none
};
VisibilityBuffer visibilityBuffer(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                                  const Tensor& camera, int64_t height, int64_t width,
                                  const RasterOptions& options = {});
// The nearest faces alone, as whoever shades a part of the picture reads them.
struct NearestFaces {
    Tensor screen;  // [V,4] pixels from the picture's centre, 1/depth, 0
    // [H,W] int32; -1: none. With keys [H,W,2]: the face's complement and the bits of its 1/depth,
    // both 0 where there is none; devices with 64-bit atomics find both in one pass.
    Tensor index;
    bool keys = false;
};
NearestFaces nearestFaces(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                          const Tensor& camera, int64_t height, int64_t width,
                          const RasterOptions& options = {});

// image[H,W,3]: the texture [Ht,Wt,3] at the visible faces' UVs, bilinear, clamped at the border;
// 0 where no face is seen. Gradient to the texture.
Tensor texturedRender(Graph& graph, const VisibilityBuffer& visibility, const RasterAtlas& atlas,
                      const Tensor& texture);

// Which stretches of kSpan pixels, in reading order, have a face at any of their samples: [1+n]
// int32, their count and the first pixel of each, in no order. For those who shade nothing else.
Tensor seenSpans(Graph& graph, const NearestFaces& nearest, int64_t height, int64_t width,
                 int64_t samples);
// Workgroups, of 64 invocations each, that share the spans of so many pixels.
Groups spanGroups(const Device& device, int64_t pixels);

// A picture for the eye: samples x samples of texturedRender's per pixel, averaged. No gradients.
struct SampledRender {
    Tensor image;     // [H,W,3] 0 where no face is seen
    Tensor coverage;  // [H,W] the part of the samples at which a face is seen
};
// camera: as of a picture of samples x height by samples x width pixels.
SampledRender sampledRender(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                            const Tensor& camera, const RasterAtlas& atlas, const Tensor& texture,
                            int64_t height, int64_t width, int64_t samples,
                            const RasterOptions& options = {});

// x_v = U(M), visibility[size,size]: 1 at texels whose centre lies in a face (edges included) with
// dot(n, -v0) > 0, n = (v1 - v0) x (v2 - v0); 0 elsewhere. No gradients.
Tensor visibilityMap(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                     const RasterAtlas& atlas, int64_t size, const RasterOptions& options = {});

}  // namespace doppel
