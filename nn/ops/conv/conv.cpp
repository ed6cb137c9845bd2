#include "nn/ops/conv/conv.h"

#include "nn/core/op.h"
#include "nn/ops/conv/algorithm.h"
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

// A layer is computed by the first of these that pays, in both directions.
const ConvAlgorithm& algorithmFor(const Device& device, const Windows& w) {
    for (const ConvAlgorithm* algorithm :
         {&kPixelConvolution, &kOneFeatureConvolution, &kWinogradConvolution})
        if (algorithm->pays(device, w)) return *algorithm;
    return kColumnsConvolution;
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
    const ConvAlgorithm& algorithm = algorithmFor(graph.device(), w);
    algorithm.gather(graph, w, x, weight, bias, y);
    graph.differentiate({x, weight, bias}, {y}, [=, &graph, &algorithm] {
        Tensor dy = graph.gradient(y);
        Windows back = w;
        back.largestMaps = largestMagnitude(graph, dy);
        if (graph.wantsGradient(weight))
            algorithm.weights(graph, back, x, dy, graph.gradientTarget(weight));
        if (graph.wantsGradient(bias)) biasGradient(graph, dy, graph.gradientTarget(bias));
        if (graph.wantsGradient(x))
            algorithm.sum(graph, back, dy, weight, {}, graph.gradientTarget(x));
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
    const ConvAlgorithm& algorithm = algorithmFor(graph.device(), w);
    algorithm.sum(graph, w, x, weight, bias, y);
    graph.differentiate({x, weight, bias}, {y}, [=, &graph, &algorithm] {
        Tensor dy = graph.gradient(y);
        Windows back = w;
        back.largestImage = largestMagnitude(graph, dy);
        if (graph.wantsGradient(weight))
            algorithm.weights(graph, back, dy, x, graph.gradientTarget(weight));
        if (graph.wantsGradient(bias)) biasGradient(graph, dy, graph.gradientTarget(bias));
        if (graph.wantsGradient(x))
            algorithm.gather(graph, back, dy, weight, {}, graph.gradientTarget(x));
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
