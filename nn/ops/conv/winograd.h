// Convolutions with fewer products (shaders/conv/winograd.glsl): 4x4 of stride 2 and padding 1 with
// nine sixteenths of them or two fifths (the finer image is the windows' image, the coarser one its
// maps), 4x4 of stride 1 with a fifth, 3x3 with a quarter. For nn/ops/conv/conv.cpp; each adds its
// dispatches to the current op.
#pragma once

#include "nn/ops/conv/windows.h"

namespace doppel {

// Whether the layer is of that kind and large enough to gain.
bool winogradPays(const Device& device, const Windows& w);

// maps = weight columns(image) (+ bias per feature)
void winogradGather(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                    const Tensor& bias, const Tensor& maps);

// image = sum over the windows that see a pixel of weight^T maps (+ bias per channel)
void winogradSum(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                 const Tensor& bias, const Tensor& image);

// dweight = sum over images and windows of maps columns(image)^T
void winogradWeights(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                     const Tensor& dweight);

}  // namespace doppel
