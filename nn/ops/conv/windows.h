// The geometry that a convolution, its transpose and their gradients share. For
// nn/ops/conv/conv.cpp and the ways of computing them; not a part of nn's interface.
#pragma once

#include <utility>

#include "engine/files/numbers.h"
#include "nn/core/graph.h"

namespace doppel {

// Windows over images, as in conv/params.h. A convolution gathers from them, its transpose sums
// into them; either way weight is [features, channels * kernel] with one feature map per window.
struct Windows {
    int64_t images = 0, channels = 0, height = 0, width = 0;
    int64_t features = 0, kernelH = 0, kernelW = 0, stride = 0, padding = 0;
    int64_t outHeight = 0, outWidth = 0;
    Tensor largestImage, largestMaps;  // see Gemm: of what is made of gradients

    int64_t windows() const { return outHeight * outWidth; }
    int64_t rows() const { return channels * kernelH * kernelW; }
    int64_t pixels() const { return height * width; }
    double flops() const {
        return 2.0 * static_cast<double>(images * features) *
               static_cast<double>(rows() * windows());
    }
    // Where the stride is 1: those of the kernel, turned by half a turn, over the maps, one per
    // pixel of the image.
    Windows turned() const {
        Windows t = *this;
        std::swap(t.channels, t.features);
        std::swap(t.height, t.outHeight);
        std::swap(t.width, t.outWidth);
        std::swap(t.largestImage, t.largestMaps);
        t.padding = kernelH - 1 - padding;
        return t;
    }
    Specialisation specialisation() const {
        return {{"kKernelH", u32(kernelH)}, {"kKernelW", u32(kernelW)}, {"kStride", u32(stride)}};
    }
};

// Workgroups of up to 256 along x, and y, z as they are.
Groups planes(int64_t x, int64_t y, int64_t z, Specialisation& spec);

}  // namespace doppel
