#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(ImageParams, 3)
BUFFER(0, readonly, float, columns);  // [channels * kKernelH * kKernelW, images * windows]
BUFFER(1, writeonly, float, image);   // [images, all channels, height, width]
BUFFER(2, readonly, float, bias);     // [all channels]

layout(constant_id = 1) const uint kKernelH = 4;
layout(constant_id = 2) const uint kKernelW = 4;
layout(constant_id = 3) const uint kStride = 2;
layout(constant_id = 4) const bool kBias = false;
layout(constant_id = 5) const bool kTurned = false;  // columns count the kernel from its last place

// The transpose of columns.gather: each pixel sums what the windows over it hold for it.
// Workgroups: x pixels, y channels, z images.
ENTRY(sum) {
    uint pixel = gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex();
    uint channel = gl_WorkGroupID.y, n = gl_WorkGroupID.z;
    uint width = params.width, height = params.height;
    if (pixel >= width * height) return;
    uint y = quotient(pixel, params.byWidth), x = remainder(pixel, y, params.byWidth);
    // Kernel rows ky0, ky0 + kStride, … see this pixel, from window rows oy0, oy0 - 1, …
    uint oy0 = (y + params.padding) / kStride, ky0 = (y + params.padding) % kStride;
    uint ox0 = (x + params.padding) / kStride, kx0 = (x + params.padding) % kStride;
    uint outHeight = params.outHeight, outWidth = params.outWidth;
    uint windows = params.images * outHeight * outWidth, first = n * outHeight * outWidth;
    uint row = channel * (kKernelH * kKernelW);
    float total = kBias ? bias.d[params.firstChannel + channel] : 0;
    [[unroll]] for (uint j = 0; j * kStride < kKernelH; ++j) {
        [[unroll]] for (uint i = 0; i * kStride < kKernelW; ++i) {
            uint ky = ky0 + j * kStride, kx = kx0 + i * kStride, oy = oy0 - j, ox = ox0 - i;
            bool seen = ky < kKernelH && kx < kKernelW && oy < outHeight && ox < outWidth;
            uint window = first + oy * outWidth + ox;
            uint place = ky * kKernelW + kx;
            if (kTurned) place = kKernelH * kKernelW - 1 - place;
            uint at = seen ? (row + place) * windows + window : 0;
            float v = columns.d[at];
            total += seen ? v : 0;
        }
    }
    uint plane = (params.firstChannel + channel) * height * width;
    image.d[params.startImage + n * params.strideImage + plane + pixel] = total;
}
