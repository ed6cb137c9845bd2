// Textures: channels side by side, [H,W,C], as the rasterizer takes them.
#pragma once

#include <span>
#include <vector>

#include "nn/body/texel_places.h"
#include "nn/core/graph.h"

namespace doppel {

// The networks' images (planes of one channel) x [N,C,H,W] as N textures [H,W,C]. Gradient to x.
std::vector<Tensor> interleave(Graph& graph, const Tensor& x);

// Blocks of r x r pixels against channels, y[n, c, r h + i, r w + j] = x[n, c r r + i r + j, h, w]:
// x [N,C r r,H,W] to y [N,C,H r,W r]. Gradient to x.
Tensor pixelShuffle(Graph& graph, const Tensor& x, int64_t block);
// Its inverse.
Tensor pixelUnshuffle(Graph& graph, const Tensor& x, int64_t block);

// y = the mean of the 3x3 texels around each, weighted by 1 2 1 along either axis; zeros beyond the
// border. x, y [H,W,C]. A texture that is learned through it has no pattern finer than a picture
// shows: what nobody sees would be noise. Gradient to x.
Tensor binomialMean(Graph& graph, const Tensor& x);
// The same on the host.
std::vector<float> binomialMean(const std::vector<float>& x, int64_t height, int64_t width,
                                int64_t channels);

// Where texels lie on a mesh, as constants of a graph.
struct TexelTensors {
    Tensor faces;    // [T,T] int32; -1: between the charts
    Tensor corners;  // [T,T,2] the second and third barycentrics
};
TexelTensors texelTensors(Graph& graph, std::span<const TexelPlace> places);

// A texture [T,T,3] under a light [9,3] of spherical harmonics (shaders/texture/lit_texture.comp),
// on a mesh with these normals [V,3], which are unit or zero. faceVertices [F,4]: as RasterMesh's.
// Gradients to texture and light; normals are constants of it.
Tensor litTexture(Graph& graph, const Tensor& texture, const Tensor& light, const Tensor& normals,
                  const Tensor& faceVertices, const TexelTensors& texels);

}  // namespace doppel
