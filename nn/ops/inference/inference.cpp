#include "nn/ops/inference/inference.h"

#include <algorithm>

#include "common/panels.h"
#include "engine/files/numbers.h"
#include "inference/params.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

int64_t weightQuads(int64_t kernel) { return (kernel * kernel + 4) / 4; }

void checkPicture(const Tensor& x) {
    CHECK(x.shape.size() == 4 && x.dim(0) == 1 && x.elements() > 0, "{} is one picture",
          toString(x.shape));
    CHECK(4 * x.elements() < int64_t{1} << 31, "{} has less than 2^29 elements", toString(x.shape));
}

// Rows of y that an invocation makes: more of them load less, and leave less to spread over cores.
int64_t rowsEach(const Shape& out) {
    constexpr int64_t kInvocations = 2048;
    for (int64_t rows : {4, 2}) {
        if (out[2] % rows == 0 && elementCount(out) / (4 * rows) >= kInvocations) return rows;
    }
    return 1;
}

}  // namespace

std::vector<float> depthwiseWeights(std::span<const float> weight, std::span<const float> bias,
                                    int64_t channels, int64_t kernel) {
    const auto taps = size_t(kernel * kernel), row = size_t(4 * weightQuads(kernel));
    CHECK(weight.size() == size_t(channels) * taps && bias.size() == size_t(channels),
          "weights are [{},{},{}], biases [{}]", channels, kernel, kernel, channels);
    std::vector<float> rows(size_t(channels) * row);
    for (size_t c = 0; c < size_t(channels); ++c) {
        std::copy_n(&weight[c * taps], taps, &rows[c * row]);
        rows[c * row + taps] = bias[c];
    }
    return rows;
}

Tensor depthwiseConv2d(Graph& graph, const Tensor& x, const Tensor& weight, int64_t kernel,
                       int64_t stride, const Borders& borders, bool relu6) {
    checkPicture(x);
    const int64_t channels = x.dim(1);
    const int64_t height = x.dim(2) + borders.top + borders.bottom,
                  width = x.dim(3) + borders.left + borders.right;
    CHECK((kernel == 3 || kernel == 5) && stride >= 1 && height >= kernel && width >= kernel,
          "a kernel of {} every {} fits {}", kernel, stride, toString(x.shape));
    CHECK(weight.elements() == channels * 4 * weightQuads(kernel), "weights {} are those of {}",
          toString(weight.shape), toString(x.shape));
    const Shape out{1, channels, (height - kernel) / stride + 1, (width - kernel) / stride + 1};
    Tensor y = graph.temporary(out);
    const int64_t rows = rowsEach(out), columns = (out[3] + 3) / 4, groups = out[2] / rows;
    const bool texels = x.dim(3) % 4 == 0 && out[3] % 4 == 0;
    graph.beginOp("depthwise_conv2d", 2. * double(y.elements() * kernel * kernel));
    const DepthwiseParams params{.n = u32(channels * groups * columns),
                                 .height = u32(x.dim(2)),
                                 .width = u32(x.dim(3)),
                                 .outHeight = u32(out[2]),
                                 .outWidth = u32(out[3]),
                                 .paddingTop = borders.top,
                                 .byColumns = divisorOf(uint64_t(columns)),
                                 .byRows = divisorOf(uint64_t(groups))};
    graph.dispatch("inference/depthwise.forward",
                   {{"weight", weight}, {"x", x}, {"xQuads", x}, {"y", y}, {"yQuads", y}}, params,
                   params.n,
                   {{"kKernel", u32(kernel)},
                    {"kStride", u32(stride)},
                    {"kLeft", borders.left},
                    {"kRows", u32(rows)},
                    {"kRelu6", relu6},
                    {"kTexels", texels}});
    return y;
}

Tensor pixelConv2d(Graph& graph, const Tensor& x, std::span<const float> weight,
                   std::span<const float> bias, bool relu6, const Tensor& residual) {
    checkPicture(x);
    const int64_t channels = x.dim(1), features = int64_t(bias.size());
    const int64_t pixels = x.dim(2) * x.dim(3);
    CHECK(features > 0 && weight.size() == size_t(features * channels), "weights are [{},{}]",
          features, channels);
    const Shape out{1, features, x.dim(2), x.dim(3)};
    CHECK(!residual || residual.shape == out, "what is added has the shape {}", toString(out));
    Tensor y = residual ? residual : graph.temporary(out);

    // Weights stay, so they are put into panels here and not in every replay.
    const int64_t rows = gemmPanelRows(graph.device(), features), steps = gemmPanelSteps(channels);
    const int64_t panels = (features + rows - 1) / rows;
    std::vector<float> packed(size_t(panels * steps * rows));
    for (int64_t o = 0; o < features; ++o) {
        for (int64_t c = 0; c < channels; ++c) {
            packed[panelIndex(u32(o), u32(c), u32(steps), u32(rows))] =
                weight[size_t(o * channels + c)];
        }
    }
    const Gemm product{.m = features,
                       .n = pixels,
                       .k = channels,
                       .panelsA = true,
                       .accumulate = bool(residual),
                       .bias = graph.constant(bias, {features}),
                       .biasPerRow = true,
                       .relu6 = relu6};
    graph.beginOp("pixel_conv2d", flops(product));
    gemm(graph, graph.constant(std::span<const float>(packed), {panels, steps, rows}), x, y,
         product);
    return y;
}

Tensor upsample2(Graph& graph, const Tensor& x, const Tensor& more) {
    checkPicture(x);
    const Shape out{1, x.dim(1), 2 * x.dim(2), 2 * x.dim(3)};
    CHECK(!more || more.shape == out, "what is added has the shape {}", toString(out));
    Tensor y = graph.temporary(out), added = more ? more : graph.none();
    const bool quads = x.dim(3) % 4 == 0;
    const int64_t columns = quads ? x.dim(3) / 4 : out[3], rows = quads ? x.dim(2) : out[2];
    graph.beginOp("upsample2");
    const UpsampleParams params{.n = u32(x.dim(1) * rows * columns),
                                .height = u32(x.dim(2)),
                                .width = u32(x.dim(3)),
                                .byColumns = divisorOf(uint64_t(columns)),
                                .byRows = divisorOf(uint64_t(rows))};
    const Specialisation spec{{"kAdd", bool(more)}};
    if (quads) {
        graph.dispatch("inference/upsample.forward_quads",
                       {{"xQuads", x}, {"moreQuads", added}, {"yQuads", y}}, params, params.n,
                       spec);
    } else {
        graph.dispatch("inference/upsample.forward", {{"x", x}, {"more", added}, {"y", y}}, params,
                       params.n, spec);
    }
    return y;
}

Tensor depthToSpace2(Graph& graph, const Tensor& x) {
    checkPicture(x);
    CHECK(x.dim(1) % 4 == 0, "{} has channels for blocks of 2x2", toString(x.shape));
    Tensor y = graph.temporary({1, x.dim(1) / 4, 2 * x.dim(2), 2 * x.dim(3)});
    graph.beginOp("depth_to_space2");
    const DepthToSpaceParams params{.n = u32(y.elements()),
                                    .channels = u32(y.dim(1)),
                                    .height = u32(x.dim(2)),
                                    .width = u32(x.dim(3)),
                                    .byColumns = divisorOf(uint64_t(y.dim(3))),
                                    .byRows = divisorOf(uint64_t(y.dim(2)))};
    graph.dispatch("inference/depth_to_space.forward", {{"x", x}, {"y", y}}, params, params.n);
    return y;
}

Tensor channelsLast(Graph& graph, const Tensor& x) {
    checkPicture(x);
    Tensor y = graph.temporary({1, x.dim(2), x.dim(3), x.dim(1)});
    graph.beginOp("channels_last");
    const ChannelsLastParams params{.n = u32(x.elements()),
                                    .channels = u32(x.dim(1)),
                                    .pixels = u32(x.dim(2) * x.dim(3)),
                                    .byChannels = divisorOf(uint64_t(x.dim(1)))};
    graph.dispatch("inference/channels_last.forward", {{"x", x}, {"y", y}}, params, params.n);
    return y;
}

}  // namespace doppel
