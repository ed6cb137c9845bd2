// Convolutions of stride 1 with one feature.
//
// What a window sees of many channels is many times its one result. So the roles are exchanged:
// each place of the kernel is multiplied with all pixels, [kernel, channels] [channels, pixels],
// and a window sums what lies at its places; for the gradients, columns are made of the one map.
// Turned, a kernel over the image is one over the map.
#include "conv/params.h"
#include "nn/ops/conv/algorithm.h"
#include "nn/ops/conv/columns.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

bool hasOneFeature(const Device&, const Windows& w) {
    return w.features == 1 && w.stride == 1 && w.channels >= 8 && w.kernelH == w.kernelW &&
           w.padding < w.kernelH && w.kernelH * w.kernelW * w.pixels() <= kColumnsElements;
}

void oneFeatureMaps(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                    const Tensor& bias, const Tensor& maps) {
    Windows t = w.turned();
    int64_t kernel = w.kernelH * w.kernelW;
    for (int64_t n = 0; n < w.images; ++n) {
        Tensor products = graph.temporary({kernel, w.pixels()});
        gemm(graph, weight, image, products,
             {.m = kernel,
              .n = w.pixels(),
              .k = w.channels,
              .transA = true,
              .startB = n * w.channels * w.pixels(),
              .largestB = w.largestImage});
        ImageParams params{.height = u32(t.height),
                           .width = u32(t.width),
                           .outHeight = u32(t.outHeight),
                           .outWidth = u32(t.outWidth),
                           .images = 1,
                           .startImage = u32(n * w.windows()),
                           .strideImage = u32(w.windows()),
                           .padding = u32(t.padding),
                           .firstChannel = 0,
                           .byWidth = divisorOf(uint64_t(t.width))};
        Specialisation spec = w.specialisation();
        Groups groups = planes(w.windows(), 1, 1, spec);
        spec["kBias"] = bias ? 1 : 0;
        spec["kTurned"] = 1;
        graph.dispatchGroups(
            "conv/image.sum",
            {{"columns", products}, {"image", maps}, {"bias", bias ? bias : graph.none()}}, params,
            groups, spec);
    }
}

void oneFeatureImage(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                     const Tensor& bias, const Tensor& image) {
    Windows t = w.turned();
    for (int64_t n = 0; n < w.images; ++n) {
        Tensor columns = gatherColumns(graph, t, maps, n, 1, 0, t.windows(), true, true);
        gemm(graph, weight, columns, image,
             {.m = w.channels,
              .n = w.pixels(),
              .k = w.kernelH * w.kernelW,
              .panelsB = true,
              .startC = n * w.channels * w.pixels(),
              .bias = bias,
              .biasPerRow = true,
              .largestB = w.largestMaps});
    }
}

void oneFeatureWeights(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                       const Tensor& dweight) {
    Windows t = w.turned();
    for (int64_t n = 0; n < w.images; ++n) {
        Tensor columns = gatherColumns(graph, t, maps, n, 1, 0, t.windows(), false, true);
        gemm(graph, image, columns, dweight,
             {.m = w.channels,
              .n = w.kernelH * w.kernelW,
              .k = w.pixels(),
              .panelsB = true,
              .accumulate = n > 0,
              .startA = n * w.channels * w.pixels(),
              .largestA = w.largestImage,
              .largestB = w.largestMaps});
    }
}

}  // namespace

const ConvAlgorithm kOneFeatureConvolution{hasOneFeature, oneFeatureMaps, oneFeatureImage,
                                           oneFeatureWeights};

}  // namespace doppel
