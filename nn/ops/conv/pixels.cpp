// Convolutions 1x1 of stride 1: a window is a pixel, and images are their own columns.
#include "nn/ops/conv/algorithm.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

bool seesPixels(const Device&, const Windows& w) {
    return w.kernelH == 1 && w.kernelW == 1 && w.stride == 1 && w.padding == 0;
}

// Maps of the image or, toImage, the image of the maps.
void pixelProduct(Graph& graph, const Windows& w, const Tensor& given, const Tensor& weight,
                  const Tensor& bias, const Tensor& result, bool toImage) {
    int64_t rows = toImage ? w.channels : w.features, sums = toImage ? w.features : w.channels;
    gemm(graph, weight, given, result,
         {.m = rows,
          .n = w.pixels(),
          .k = sums,
          .transA = toImage,
          .batch = w.images,
          .strideB = sums * w.pixels(),
          .strideC = rows * w.pixels(),
          .bias = bias,
          .biasPerRow = true,
          .largestB = toImage ? w.largestMaps : w.largestImage});
}

void pixelWeights(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                  const Tensor& dweight) {
    for (int64_t n = 0; n < w.images; ++n)
        gemm(graph, maps, image, dweight,
             {.m = w.features,
              .n = w.channels,
              .k = w.pixels(),
              .transB = true,
              .accumulate = n > 0,
              .startA = n * w.features * w.pixels(),
              .startB = n * w.channels * w.pixels(),
              .largestA = w.largestMaps,
              .largestB = w.largestImage});
}

void pixelMaps(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
               const Tensor& bias, const Tensor& maps) {
    pixelProduct(graph, w, image, weight, bias, maps, false);
}

void pixelImage(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                const Tensor& bias, const Tensor& image) {
    pixelProduct(graph, w, maps, weight, bias, image, true);
}

}  // namespace

const ConvAlgorithm kPixelConvolution{seesPixels, pixelMaps, pixelImage, pixelWeights};

}  // namespace doppel
