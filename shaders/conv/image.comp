// The transpose of conv/columns.comp: each pixel sums what the windows over it hold for it,
//     image[n, channel, y, x] = bias[channel] + the sum over ky, kx of columns[(channel, ky, kx),
//                               (n, (y + padding - ky) / stride, (x + padding - kx) / stride)],
// of those windows that there are; so that image = columns(weight^T maps) is a transposed
// convolution, or the gradient of a convolution's image. Columns lie row by row.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "conv/params.h"
PARAMS(ImageParams, 4)
BUFFER(0, readonly, float, columns);  // [channels * kKernelH * kKernelW, images * windows]
BUFFER(1, writeonly, float, image);   // [images, all channels, height, width]
BUFFER(2, readonly, float, bias);     // [all channels]
BUFFER(3, writeonly, vec2, pairs);    // the image, in pairs

layout(constant_id = 1) const uint kKernelH = 4;
layout(constant_id = 2) const uint kKernelW = 4;
layout(constant_id = 3) const uint kStride = 2;
layout(constant_id = 4) const bool kBias = false;
layout(constant_id = 5) const bool kTurned = false;  // columns count the kernel from its last place

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

// Likewise for kernels 4x4 of stride 2 and padding 1 over an image twice as high and wide as there
// are windows. One invocation per window: the four pixels in its middle, of which each is seen by
// this window, by one above or below, by one beside, and by one across.
// Workgroups: x windows, y channels, z images.
ENTRY(sum_blocks) {
    uint window = gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex();
    uint channel = gl_WorkGroupID.y, n = gl_WorkGroupID.z, across = params.outWidth;
    uint windowsEach = params.outHeight * across, windows = params.images * windowsEach;
    if (window >= windowsEach) return;
    uint y = quotient(window, params.byWidth), x = remainder(window, y, params.byWidth);
    bool rowSeen[2] = bool[2](y > 0, y + 1 < params.outHeight);
    bool columnSeen[2] = bool[2](x > 0, x + 1 < across);
    uint base = channel * 16 * windows + n * windowsEach + window;
    float b = kBias ? bias.d[params.firstChannel + channel] : 0;
    uint plane = (params.firstChannel + channel) * params.height * params.width;
    plane += params.startImage + n * params.strideImage + 2 * (y * params.width + x);
    [[unroll]] for (uint r = 0; r < 2; ++r) {
        vec2 total = vec2(b);
        [[unroll]] for (uint c = 0; c < 2; ++c)
            [[unroll]] for (uint j = 0; j < 2; ++j)
                [[unroll]] for (uint i = 0; i < 2; ++i) {
                    // The window itself, or the one before (r, c = 0) or behind it.
                    uint ky = j == 0 ? 1 + r : 3 - 3 * r, kx = i == 0 ? 1 + c : 3 - 3 * c;
                    uint at = base + (4 * ky + kx) * windows;
                    if (j == 1) at += (2 * r - 1) * across;
                    if (i == 1) at += 2 * c - 1;
                    bool seen = (j == 0 || rowSeen[r]) && (i == 0 || columnSeen[c]);
                    float v = columns.d[seen ? at : base];
                    total[c] += seen ? v : 0;
                }
        pairs.d[(plane + r * params.width) / 2] = total;
    }
}
