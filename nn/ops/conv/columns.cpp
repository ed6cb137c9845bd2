#include "nn/ops/conv/columns.h"

#include <algorithm>

#include "conv/params.h"
#include "nn/ops/conv/algorithm.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

// Where columns are a product's result, the other side of the product is read again for each part.
constexpr int64_t kProductElements = 4 * kColumnsElements;

// Whether each window has four pixels in its middle that no other has there.
bool seesBlocks(const Windows& w) {
    return w.kernelH == 4 && w.kernelW == 4 && w.stride == 2 && w.padding == 1 &&
           w.height == 2 * w.outHeight && w.width == 2 * w.outWidth;
}

}  // namespace

Tensor gatherColumns(Graph& graph, const Windows& w, const Tensor& image, int64_t firstImage,
                     int64_t images, int64_t firstWindow, int64_t windows, bool windowPanels,
                     bool turned) {
    int64_t across = windowPanels ? images * windows : w.rows();
    int64_t along = windowPanels ? w.rows() : images * windows;
    int64_t width = gemmPanelWidth(graph.device(), across);
    Tensor columns = graph.temporary({(across + width - 1) / width, along, width});
    ColumnsParams params{.channels = u32(w.channels),
                         .height = u32(w.height),
                         .width = u32(w.width),
                         .windows = u32(windows),
                         .firstWindow = u32(firstWindow),
                         .images = u32(images),
                         .startImage = u32(firstImage * w.channels * w.pixels()),
                         .padding = u32(w.padding),
                         .rows = u32(w.rows()),
                         .byOutWidth = divisorOf(uint64_t(w.outWidth))};
    const bool strided = seesBlocks(w) && w.outWidth % 2 == 0;
    CHECK(!strided || !turned, "kernels are turned where the stride is 1");
    Specialisation spec;
    if (!strided) {
        spec = w.specialisation();
        spec["kTurned"] = turned;
    }
    Groups groups = planes(strided ? windows / 2 : windows, w.channels, images, spec);
    spec["kWidth"] = u32(width);
    spec["kWindowPanels"] = windowPanels;
    graph.dispatchGroups(
        strided ? "conv/columns.gather_strided" : "conv/columns.gather",
        {{"image", image}, {"columns", columns}, {"imageQuads", image}, {"pairs", columns}}, params,
        groups, spec);
    return columns;
}

namespace {

// A layer's images are worked on one by one where each has windows enough to fill a product's
// tiles; else several together, their maps joined to [features, images * windows].
constexpr int64_t kWindowsEnough = 256;

int64_t imagesAtOnce(const Windows& w) {
    if (w.windows() >= kWindowsEnough) return 1;
    return std::clamp<int64_t>(kColumnsElements / (w.rows() * w.windows()), 1, w.images);
}

// Windows whose columns fit into one piece; even, and a multiple of any panel.
int64_t windowsAtOnce(const Windows& w) {
    constexpr int64_t kMultiple = 128;
    int64_t fit = kColumnsElements / w.rows() / kMultiple * kMultiple;
    return std::min(w.windows(), std::max({fit, kMultiple, std::min(kWindowsEnough, w.windows())}));
}

void reorderMaps(Graph& graph, const char* kernel, const Windows& w, const Tensor& maps,
                 int64_t firstImage, int64_t images, const Tensor& joined) {
    MapsParams params{.elements = u32(images * w.features * w.windows()),
                      .start = u32(firstImage * w.features * w.windows()),
                      .windows = u32(w.windows()),
                      .images = u32(images),
                      .byWindows = divisorOf(uint64_t(w.windows())),
                      .byFeatures = divisorOf(uint64_t(w.features))};
    graph.dispatch(kernel, {{"maps", maps}, {"joined", joined}}, params, params.elements);
}

// maps[images, features, windows] = weight columns(image) (+ bias per feature)
void gatherProduct(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                   const Tensor& bias, const Tensor& maps) {
    int64_t atOnce = imagesAtOnce(w), part = windowsAtOnce(w);
    Gemm product{.m = w.features,
                 .k = w.rows(),
                 .panelsB = true,
                 .bias = bias,
                 .biasPerRow = true,
                 .largestB = w.largestImage};
    for (int64_t n = 0; n < w.images; n += atOnce) {
        int64_t images = std::min(atOnce, w.images - n);
        if (images > 1) {
            Tensor columns = gatherColumns(graph, w, image, n, images, 0, w.windows(), true);
            Tensor joined = graph.temporary({w.features, images, w.windows()});
            product.n = product.ldc = images * w.windows();
            gemm(graph, weight, columns, joined, product);
            reorderMaps(graph, "conv/maps.part", w, maps, n, images, joined);
            continue;
        }
        for (int64_t first = 0; first < w.windows(); first += part) {
            product.n = std::min(part, w.windows() - first);
            product.ldc = w.windows();
            product.startC = n * w.features * w.windows() + first;
            Tensor columns = gatherColumns(graph, w, image, n, 1, first, product.n, true);
            gemm(graph, weight, columns, maps, product);
        }
        product.startC = 0;
    }
}

// dweight[features, rows] = sum over images and windows of maps columns(image)^T
void weightProduct(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                   const Tensor& dweight) {
    int64_t atOnce = imagesAtOnce(w), part = windowsAtOnce(w);
    Gemm product{.m = w.features,
                 .n = w.rows(),
                 .panelsB = true,
                 .largestA = w.largestMaps,
                 .largestB = w.largestImage};
    for (int64_t n = 0; n < w.images; n += atOnce) {
        int64_t images = std::min(atOnce, w.images - n);
        if (images > 1) {
            Tensor columns = gatherColumns(graph, w, image, n, images, 0, w.windows(), false);
            Tensor joined = graph.temporary({w.features, images, w.windows()});
            reorderMaps(graph, "conv/maps.join", w, maps, n, images, joined);
            product.k = product.lda = images * w.windows();
            product.startA = 0;
            gemm(graph, joined, columns, dweight, product);
            product.accumulate = true;
            continue;
        }
        for (int64_t first = 0; first < w.windows(); first += part) {
            product.k = std::min(part, w.windows() - first);
            product.lda = w.windows();
            product.startA = n * w.features * w.windows() + first;
            Tensor columns = gatherColumns(graph, w, image, n, 1, first, product.k, false);
            gemm(graph, maps, columns, dweight, product);
            product.accumulate = true;
        }
    }
}

// image = sum over the windows that see a pixel of weight^T maps (+ bias per channel)
void sumProduct(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                const Tensor& bias, const Tensor& image) {
    int64_t atOnce = imagesAtOnce(w), kernel = w.kernelH * w.kernelW;
    int64_t part = std::clamp<int64_t>(kProductElements / (kernel * w.windows()), 1, w.channels);
    if (atOnce > 1) part = w.channels;
    for (int64_t n = 0; n < w.images; n += atOnce) {
        int64_t images = std::min(atOnce, w.images - n);
        Tensor joined = maps;
        if (images > 1) {
            joined = graph.temporary({w.features, images, w.windows()});
            reorderMaps(graph, "conv/maps.join", w, maps, n, images, joined);
        }
        for (int64_t channel = 0; channel < w.channels; channel += part) {
            int64_t channels = std::min(part, w.channels - channel);
            Tensor columns = graph.temporary({channels * kernel, images, w.windows()});
            gemm(graph, weight, joined, columns,
                 {.m = channels * kernel,
                  .n = images * w.windows(),
                  .k = w.features,
                  .transA = true,
                  .lda = w.rows(),
                  .startA = channel * kernel,
                  .startB = images > 1 ? 0 : n * w.features * w.windows(),
                  .largestB = w.largestMaps});
            bool blocks = seesBlocks(w);  // of four pixels per window
            ImageParams params{.height = u32(w.height),
                               .width = u32(w.width),
                               .outHeight = u32(w.outHeight),
                               .outWidth = u32(w.outWidth),
                               .images = u32(images),
                               .startImage = u32(n * w.channels * w.pixels()),
                               .strideImage = u32(w.channels * w.pixels()),
                               .padding = u32(w.padding),
                               .firstChannel = u32(channel),
                               .byWidth = divisorOf(uint64_t(blocks ? w.outWidth : w.width))};
            Specialisation spec = blocks ? Specialisation{} : w.specialisation();
            Groups groups = planes(blocks ? w.windows() : w.pixels(), channels, images, spec);
            spec["kBias"] = bias ? 1 : 0;
            graph.dispatchGroups(blocks ? "conv/image.sum_blocks" : "conv/image.sum",
                                 {{"columns", columns},
                                  {blocks ? "pairs" : "image", image},
                                  {"bias", bias ? bias : graph.none()}},
                                 params, groups, spec);
        }
    }
}

}  // namespace

const ConvAlgorithm kColumnsConvolution{[](const Device&, const Windows&) { return true; },
                                        gatherProduct, sumProduct, weightProduct};

}  // namespace doppel
