#include "nn/ops/conv/conv.h"

#include <algorithm>

#include "conv/params.h"
#include "nn/core/op.h"
#include "nn/ops/conv/winograd.h"
#include "nn/ops/linalg.h"

namespace doppel {

Groups planes(int64_t x, int64_t y, int64_t z, Specialisation& spec) {
    // Large ones where there is work for them: workgroups cost time of their own on CPUs.
    uint32_t size = 8;
    while (size < 256 && size < x) size *= 2;
    spec["local_size"] = size;
    CHECK(y <= 65535 && z <= 65535, "{} channels and {} images fit into one dispatch", y, z);
    return {u32((x + size - 1) / size), u32(y), u32(z)};
}

namespace {

// The columns of a layer, what each window sees, are several times its images; they are made for
// as many images, windows or channels at once as fit into this. Where they are a product's result,
// the other side of the product is read again for each part.
constexpr int64_t kColumnsElements = int64_t{1} << 20;
constexpr int64_t kProductElements = 4 * kColumnsElements;

// Whether each window has four pixels in its middle that no other has there.
bool seesBlocks(const Windows& w) {
    return w.kernelH == 4 && w.kernelW == 4 && w.stride == 2 && w.padding == 1 &&
           w.height == 2 * w.outHeight && w.width == 2 * w.outWidth;
}

// Columns, what each window of some images sees [rows, images * windows], as panels for the right
// side of a product: of windows for weight · columns, of rows for maps · columns^T (see
// conv/columns.glsl).
Tensor gatherColumns(Graph& graph, const Windows& w, const Tensor& image, int64_t firstImage,
                     int64_t images, int64_t firstWindow, int64_t windows, bool windowPanels,
                     bool turned = false) {
    int64_t across = windowPanels ? images * windows : w.rows();
    int64_t along = windowPanels ? w.rows() : images * windows;
    int64_t width = gemmPanelWidth(graph.device(), across);
    Tensor columns = graph.temporary({(across + width - 1) / width, along, width});
    ColumnsParams params{.channels = u32(w.channels),
                         .height = u32(w.height),
                         .width = u32(w.width),
                         .outWidth = u32(w.outWidth),
                         .windows = u32(windows),
                         .firstWindow = u32(firstWindow),
                         .images = u32(images),
                         .startImage = u32(firstImage * w.channels * w.pixels()),
                         .padding = u32(w.padding),
                         .byOutWidth = divisorOf(uint64_t(w.outWidth))};
    bool pairs = seesBlocks(w) && w.outWidth % 2 == 0;
    Specialisation spec;
    CHECK(!pairs || !turned, "kernels are turned where the stride is 1");
    if (!pairs) {
        spec = w.specialisation();
        spec["kTurned"] = turned;
    }
    Groups groups = planes(pairs ? windows / 2 : windows, w.channels, images, spec);
    spec["kWidth"] = u32(width);
    spec["kWindowPanels"] = windowPanels;
    const char* kernel = !pairs ? "conv/columns.gather"
                         : loadsTexels(graph.device()) && w.width % 4 == 0
                             ? "conv/columns_texels.gather"
                             : "conv/columns_pairs.gather";
    graph.dispatchGroups(kernel, {{"image", image}, {"columns", columns}}, params, groups, spec);
    return columns;
}

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

// ---- one feature, stride 1 ----------------------------------------------------------------------
// What a window sees of many channels is many times its one result. So the roles are exchanged:
// each place of the kernel is multiplied with all pixels, [kernel, channels] [channels, pixels],
// and a window sums what lies at its places; for the gradients, columns are made of the one map.
// Turned, a kernel over the image is one over the map.

bool hasOneFeature(const Windows& w) {
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
        ImageParams params{.channels = 1,
                           .height = u32(t.height),
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

// ---- 1x1, stride 1 ------------------------------------------------------------------------------
// A window is a pixel, and images are their own columns.

bool seesPixels(const Windows& w) {
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

// ---- any layer ----------------------------------------------------------------------------------

// maps[images, features, windows] = weight columns(image) (+ bias per feature)
void gatherProduct(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                   const Tensor& bias, const Tensor& maps) {
    if (seesPixels(w)) return pixelProduct(graph, w, image, weight, bias, maps, false);
    if (hasOneFeature(w)) return oneFeatureMaps(graph, w, image, weight, bias, maps);
    if (winogradPays(graph.device(), w)) return winogradGather(graph, w, image, weight, bias, maps);
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
    if (seesPixels(w)) return pixelWeights(graph, w, image, maps, dweight);
    if (hasOneFeature(w)) return oneFeatureWeights(graph, w, image, maps, dweight);
    if (winogradPays(graph.device(), w)) return winogradWeights(graph, w, image, maps, dweight);
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
    if (seesPixels(w)) return pixelProduct(graph, w, maps, weight, bias, image, true);
    if (hasOneFeature(w)) return oneFeatureImage(graph, w, maps, weight, bias, image);
    if (winogradPays(graph.device(), w)) return winogradSum(graph, w, maps, weight, bias, image);
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
            ImageParams params{.channels = u32(channels),
                               .height = u32(w.height),
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

// dbias[C] = sum over images and pixels of dy[N,C,...]
void biasGradient(Graph& graph, const Tensor& dy, const Tensor& dbias) {
    int64_t N = dy.dim(0), C = dy.dim(1), pixels = dy.dim(2) * dy.dim(3);
    if (N == 1) {
        sumAxis(graph, dy, C, pixels, 1, dbias);
        return;
    }
    Tensor perImage = graph.temporary({N, C});
    sumAxis(graph, dy, N * C, pixels, 1, perImage);
    sumAxis(graph, perImage, 1, N, C, dbias);
}

// Image sizes must fit 31 bits: that is how far the kernels count.
void checkSizes(const Windows& w) {
    constexpr int64_t kMost = (int64_t{1} << 31) - 1;
    CHECK(w.images * w.channels * w.pixels() <= kMost &&
              w.images * w.features * w.windows() <= kMost && w.rows() * w.features <= kMost,
          "images and feature maps have less than 2^31 elements");
}

}  // namespace

Tensor conv2d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
              uint32_t stride, uint32_t padding) {
    Windows w{x.dim(0),      x.dim(1),      x.dim(2), x.dim(3), weight.dim(0),
              weight.dim(2), weight.dim(3), stride,   padding};
    CHECK(stride > 0 && weight.dim(1) == w.channels && w.height + 2 * padding >= w.kernelH &&
              w.width + 2 * padding >= w.kernelW,
          "weight {} fits x {}", toString(weight.shape), toString(x.shape));
    w.outHeight = (w.height + 2 * padding - w.kernelH) / stride + 1;
    w.outWidth = (w.width + 2 * padding - w.kernelW) / stride + 1;
    checkSizes(w);
    Tensor y = graph.temporary({w.images, w.features, w.outHeight, w.outWidth});
    graph.beginOp("conv2d", w.flops());
    gatherProduct(graph, w, x, weight, bias, y);
    graph.differentiate({x, weight, bias}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        Windows back = w;
        back.largestMaps = largestMagnitude(graph, dy);
        if (graph.wantsGradient(weight))
            weightProduct(graph, back, x, dy, graph.gradientTarget(weight));
        if (graph.wantsGradient(bias)) biasGradient(graph, dy, graph.gradientTarget(bias));
        if (graph.wantsGradient(x))
            sumProduct(graph, back, dy, weight, {}, graph.gradientTarget(x));
    });
    return y;
}

Tensor convTranspose2d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
                       uint32_t stride, uint32_t padding) {
    // The windows lie over y, and x is their feature maps.
    Windows w{.images = x.dim(0),
              .channels = weight.dim(1),
              .features = x.dim(1),
              .kernelH = weight.dim(2),
              .kernelW = weight.dim(3),
              .stride = stride,
              .padding = padding,
              .outHeight = x.dim(2),
              .outWidth = x.dim(3)};
    w.height = (w.outHeight - 1) * stride - 2 * int64_t{padding} + w.kernelH;
    w.width = (w.outWidth - 1) * stride - 2 * int64_t{padding} + w.kernelW;
    CHECK(stride > 0 && weight.dim(0) == w.features && w.height > 0 && w.width > 0,
          "weight {} fits x {}", toString(weight.shape), toString(x.shape));
    checkSizes(w);
    Tensor y = graph.temporary({w.images, w.channels, w.height, w.width});
    graph.beginOp("conv_transpose2d", w.flops());
    sumProduct(graph, w, x, weight, bias, y);
    graph.differentiate({x, weight, bias}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        Windows back = w;
        back.largestImage = largestMagnitude(graph, dy);
        if (graph.wantsGradient(weight))
            weightProduct(graph, back, dy, x, graph.gradientTarget(weight));
        if (graph.wantsGradient(bias)) biasGradient(graph, dy, graph.gradientTarget(bias));
        if (graph.wantsGradient(x))
            gatherProduct(graph, back, dy, weight, {}, graph.gradientTarget(x));
    });
    return y;
}

// ---- for op_runner ------------------------------------------------------------------------------

namespace {

void checkWindows(const OpCall& c) {
    const Shape &x = c["x"].shape, &w = c["weight"].shape;
    if (c.u("stride") == 0) throwInput("attr_stride: expected 1 or more, found 0");
    int64_t padding = c.u("padding");
    if (x[2] + 2 * padding < w[2] || x[3] + 2 * padding < w[3])
        throwInput("weight: a kernel of {}x{} is larger than the padded image of {}x{}", w[2], w[3],
                   x[2] + 2 * padding, x[3] + 2 * padding);
}

void checkTransposed(const OpCall& c) {
    const Shape &x = c["x"].shape, &w = c["weight"].shape;
    if (c.u("stride") == 0) throwInput("attr_stride: expected 1 or more, found 0");
    int64_t stride = c.u("stride"), padding = c.u("padding");
    if ((x[2] - 1) * stride + w[2] <= 2 * padding || (x[3] - 1) * stride + w[3] <= 2 * padding)
        throwInput("attr_padding: {} leaves nothing of the image", padding);
}

}  // namespace

static const Op kConv2d{{
    .name = "conv2d",
    .inputs = "x[N,C,H,W] weight[O,C,kh,kw] bias[O]?",
    .attributes = "stride padding",
    .outputs = "y",
    .differentiable = "x weight bias",
    .build =
        [](OpCall& c) {
            checkWindows(c);
            c.result("y", conv2d(c.graph, c["x"], c["weight"], c["bias"], c.u("stride"),
                                 c.u("padding")));
        },
}};
static const Op kConvTranspose2d{{
    .name = "conv_transpose2d",
    .inputs = "x[N,C,H,W] weight[C,O,kh,kw] bias[O]?",
    .attributes = "stride padding",
    .outputs = "y",
    .differentiable = "x weight bias",
    .build =
        [](OpCall& c) {
            checkTransposed(c);
            c.result("y", convTranspose2d(c.graph, c["x"], c["weight"], c["bias"], c.u("stride"),
                                          c.u("padding")));
        },
}};

}  // namespace doppel
