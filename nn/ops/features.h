// What networks that judge pictures and videos need beyond nn/ops/conv/conv.h. A video is
// [T,C,H,W], its frames where a batch of images has its images, so that ops on images work on its
// frames. These networks are never trained: no gradients.
#pragma once

#include <array>

#include "nn/core/graph.h"

namespace doppel {

// y[N,C,H',W']: the greatest value in each window, what lies outside x left out. H' = (H + 2
// padding - kernel) / stride + 1, rounded down, or up with ceil (but no window begins beyond the
// padded end). padding is at most half the kernel.
Tensor maxPool2d(Graph& graph, const Tensor& x, uint32_t kernel, uint32_t stride,
                 uint32_t padding = 0, bool ceil = false);

// In time, height and width.
using Extent3 = std::array<uint32_t, 3>;

// The windows of TensorFlow's padding "SAME": ceil(size / stride) of them, the padding shared by
// both ends, the odd one behind.
struct SameWindows {
    int64_t count, before, total;
    SameWindows(int64_t size, uint32_t kernel, uint32_t stride);
};

// x[T,C,H,W] -> y[T',C,H',W'], padded "SAME"; what lies outside x does not count.
Tensor maxPool3d(Graph& graph, const Tensor& x, const Extent3& kernel, const Extent3& stride);

// x[T,C,H,W], weight[O,C,kt,kh,kw], bias[O] or an empty tensor -> y[T',O,H',W'], padded "SAME" with
// zeros. The strides in height and width agree.
Tensor conv3d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
              const Extent3& stride);

// a[N,C,H,W], b[N,C,H,W], weight[C] -> y[N,H,W] = sum over c of weight_c (a_c / |a| - b_c / |b|)^2,
// |.| over the channels of a pixel (plus 1e-10).
Tensor featureDistance(Graph& graph, const Tensor& a, const Tensor& b, const Tensor& weight);

}  // namespace doppel
