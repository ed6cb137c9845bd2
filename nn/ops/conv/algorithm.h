// The ways of computing a convolution, its transpose and their gradients, of which conv.cpp takes
// the first that pays. A new one is its entry there, and three functions on Windows.
#pragma once

#include "nn/ops/conv/windows.h"

namespace doppel {

struct ConvAlgorithm {
    bool (*pays)(const Device& device, const Windows& w);
    // maps[images, features, windows] = weight columns(image) (+ bias per feature)
    void (*gather)(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                   const Tensor& bias, const Tensor& maps);
    // image = sum over the windows that see a pixel of weight^T maps (+ bias per channel)
    void (*sum)(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                const Tensor& bias, const Tensor& image);
    // dweight[features, rows] = sum over images and windows of maps columns(image)^T
    void (*weights)(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                    const Tensor& dweight);
};

extern const ConvAlgorithm kPixelConvolution;       // kernels 1x1: images are their own columns
extern const ConvAlgorithm kOneFeatureConvolution;  // one map of many channels
extern const ConvAlgorithm kWinogradConvolution;    // fewer products
extern const ConvAlgorithm kColumnsConvolution;     // any layer

}  // namespace doppel
