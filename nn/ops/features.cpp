#include "nn/ops/features.h"

#include <algorithm>

#include "engine/files/numbers.h"
#include "features/params.h"
#include "nn/core/op.h"
#include "nn/ops/conv/conv.h"

namespace doppel {

namespace {

void checkSize(const Tensor& x) {
    CHECK(x.elements() < (int64_t{1} << 31), "{} has less than 2^31 elements", toString(x.shape));
}

Tensor pool(Graph& graph, const char* name, const Tensor& x, const Shape& out,
            const Extent3& kernel, const Extent3& stride, const Extent3& padding) {
    Tensor y = graph.temporary(out);
    checkSize(x), checkSize(y);
    MaxPoolParams params{.n = u32(y.elements()),
                         .channels = u32(x.dim(1)),
                         .frames = u32(x.dim(0)),
                         .height = u32(x.dim(2)),
                         .width = u32(x.dim(3)),
                         .outHeight = u32(out[2]),
                         .outWidth = u32(out[3]),
                         .kernelT = kernel[0],
                         .kernelH = kernel[1],
                         .kernelW = kernel[2],
                         .strideT = stride[0],
                         .strideH = stride[1],
                         .strideW = stride[2],
                         .paddingT = padding[0],
                         .paddingH = padding[1],
                         .paddingW = padding[2]};
    graph.beginOp(name);
    graph.dispatch("features/max_pool.forward", {{"x", x}, {"y", y}}, params, params.n);
    return y;
}

// How many windows of a 2D pooling there are along one side.
int64_t windowsAlong(int64_t size, uint32_t kernel, uint32_t stride, uint32_t padding, bool ceil) {
    int64_t room = size + 2 * int64_t{padding} - kernel;
    if (room < 0) return 0;
    int64_t count = (room + (ceil ? stride - 1 : 0)) / stride + 1;
    // A window that would begin behind the picture and its front padding sees nothing.
    if (ceil && (count - 1) * stride >= size + padding) --count;
    return count;
}

}  // namespace

Tensor maxPool2d(Graph& graph, const Tensor& x, uint32_t kernel, uint32_t stride, uint32_t padding,
                 bool ceil) {
    CHECK(stride > 0 && 2 * padding <= kernel, "windows of {} every {} with padding {}", kernel,
          stride, padding);
    Shape out{x.dim(0), x.dim(1), windowsAlong(x.dim(2), kernel, stride, padding, ceil),
              windowsAlong(x.dim(3), kernel, stride, padding, ceil)};
    CHECK(out[2] > 0 && out[3] > 0, "a window of {} fits into {}", kernel, toString(x.shape));
    return pool(graph, "max_pool2d", x, out, {1, kernel, kernel}, {1, stride, stride},
                {0, padding, padding});
}

SameWindows::SameWindows(int64_t size, uint32_t kernel, uint32_t stride)
    : count((size + stride - 1) / stride),
      total(std::max<int64_t>((count - 1) * stride + kernel - size, 0)) {
    before = total / 2;
}

Tensor maxPool3d(Graph& graph, const Tensor& x, const Extent3& kernel, const Extent3& stride) {
    SameWindows t(x.dim(0), kernel[0], stride[0]), h(x.dim(2), kernel[1], stride[1]),
        w(x.dim(3), kernel[2], stride[2]);
    return pool(graph, "max_pool3d", x, {t.count, x.dim(1), h.count, w.count}, kernel, stride,
                {u32(t.before), u32(h.before), u32(w.before)});
}

Tensor conv3d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
              const Extent3& stride) {
    int64_t channels = x.dim(1), kernelT = weight.dim(2);
    CHECK(weight.dim(1) == channels && stride[1] == stride[2], "weight {} fits x {}",
          toString(weight.shape), toString(x.shape));
    SameWindows t(x.dim(0), u32(kernelT), stride[0]), h(x.dim(2), u32(weight.dim(3)), stride[1]),
        w(x.dim(3), u32(weight.dim(4)), stride[2]);
    // The convolution of images pads all four sides alike; else the border is made here.
    bool alike = h.total == w.total && h.total % 2 == 0;
    Tensor images = x;
    if (kernelT > 1 || stride[0] > 1 || !alike) {
        int64_t height = x.dim(2) + (alike ? 0 : h.total), width = x.dim(3) + (alike ? 0 : w.total);
        images = graph.temporary({t.count, channels * kernelT, height, width});
        checkSize(images);
        StackFramesParams params{.n = u32(images.elements()),
                                 .channels = u32(channels),
                                 .frames = u32(x.dim(0)),
                                 .height = u32(x.dim(2)),
                                 .width = u32(x.dim(3)),
                                 .outHeight = u32(height),
                                 .outWidth = u32(width),
                                 .kernelT = u32(kernelT),
                                 .strideT = stride[0],
                                 .paddingT = u32(t.before),
                                 .paddingH = alike ? 0 : u32(h.before),
                                 .paddingW = alike ? 0 : u32(w.before)};
        graph.beginOp("conv3d stack");
        graph.dispatch("features/stack_frames.forward", {{"x", x}, {"y", images}}, params,
                       params.n);
    }
    Tensor flat =
        weight.reshaped({weight.dim(0), channels * kernelT, weight.dim(3), weight.dim(4)});
    return conv2d(graph, images, flat, bias, stride[1], alike ? u32(h.before) : 0);
}

Tensor featureDistance(Graph& graph, const Tensor& a, const Tensor& b, const Tensor& weight) {
    CHECK(a.shape == b.shape && weight.elements() == a.dim(1), "{} and {} are compared with {}",
          toString(a.shape), toString(b.shape), toString(weight.shape));
    checkSize(a);
    Tensor y = graph.temporary({a.dim(0), a.dim(2), a.dim(3)});
    FeatureDistanceParams params{u32(y.elements()), u32(a.dim(1)), u32(a.dim(2) * a.dim(3))};
    graph.beginOp("feature_distance");
    graph.dispatch("features/feature_distance.forward",
                   {{"a", a}, {"b", b}, {"weight", weight}, {"y", y}}, params, params.n);
    return y;
}

// ---- for op_runner ------------------------------------------------------------------------------

namespace {

uint32_t positive(const OpCall& c, const char* name) {
    if (c.u(name) == 0) throwInput("attr_{}: expected 1 or more, found 0", name);
    return c.u(name);
}

void checkNotEmpty(const OpCall& c, const char* name) {
    if (c[name].elements() == 0)
        throwInput("{}: expected pixels, found {}", name, toString(c[name].shape));
}

}  // namespace

static const Op kMaxPool2d{{
    .name = "max_pool2d",
    .inputs = "x[N,C,H,W]",
    .attributes = "kernel stride padding=0 ceil=0",
    .outputs = "y",
    .differentiable = "",
    .build =
        [](OpCall& c) {
            checkNotEmpty(c, "x");
            uint32_t kernel = positive(c, "kernel"), stride = positive(c, "stride");
            uint32_t padding = c.u("padding");
            bool ceil = c.u("ceil") != 0;
            if (2 * padding > kernel)
                throwInput("attr_padding: expected at most half the kernel of {}, found {}", kernel,
                           padding);
            for (int side : {2, 3})
                if (windowsAlong(c["x"].dim(side), kernel, stride, padding, ceil) <= 0)
                    throwInput("attr_kernel: a window of {} does not fit into {}", kernel,
                               toString(c["x"].shape));
            c.result("y", maxPool2d(c.graph, c["x"], kernel, stride, padding, ceil));
        },
}};
static const Op kMaxPool3d{{
    .name = "max_pool3d",
    .inputs = "x[T,C,H,W]",
    .attributes = "kernel_t kernel stride_t stride",
    .outputs = "y",
    .differentiable = "",
    .build =
        [](OpCall& c) {
            checkNotEmpty(c, "x");
            uint32_t kernel = positive(c, "kernel"), stride = positive(c, "stride");
            c.result("y", maxPool3d(c.graph, c["x"], {positive(c, "kernel_t"), kernel, kernel},
                                    {positive(c, "stride_t"), stride, stride}));
        },
}};
static const Op kConv3d{{
    .name = "conv3d",
    .inputs = "x[T,C,H,W] weight[O,C,kt,kh,kw] bias[O]?",
    .attributes = "stride_t stride",
    .outputs = "y",
    .differentiable = "",
    .build =
        [](OpCall& c) {
            checkNotEmpty(c, "x");
            checkNotEmpty(c, "weight");
            uint32_t stride = positive(c, "stride");
            c.result("y", conv3d(c.graph, c["x"], c["weight"], c["bias"],
                                 {positive(c, "stride_t"), stride, stride}));
        },
}};
static const Op kFeatureDistance{{
    .name = "feature_distance",
    .inputs = "a[N,C,H,W] b[N,C,H,W] weight[C]",
    .attributes = "",
    .outputs = "y",
    .differentiable = "",
    .build =
        [](OpCall& c) { c.result("y", featureDistance(c.graph, c["a"], c["b"], c["weight"])); },
}};

}  // namespace doppel
