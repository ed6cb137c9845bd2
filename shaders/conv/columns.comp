// Columns of a convolution: the matrix of what each window sees,
//     columns[(channel, ky, kx), (n, oy, ox)] = image[n, channel, stride oy + ky - padding,
//                                                     stride ox + kx - padding], 0 outside,
// so that maps = weight columns and dweight = dmaps columns^T (Chellapilla, Puri and Simard, High
// Performance Convolutional Neural Networks for Document Processing, 2006). They are written as the
// panels (common/panels.h) of these products' right sides: of windows, or of rows.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/panels.h"
#include "conv/params.h"
PARAMS(ColumnsParams, 4)
BUFFER(0, readonly, float, image);      // [images, channels, height, width]
BUFFER(1, writeonly, float, columns);   // panels of [channels * kernel, images * windows]
BUFFER(2, readonly, vec4, imageQuads);  // image again
BUFFER(3, writeonly, vec2, pairs);      // columns again

layout(constant_id = 1) const uint kKernelH = 4;
layout(constant_id = 2) const uint kKernelW = 4;
layout(constant_id = 3) const uint kStride = 2;
layout(constant_id = 4) const uint kWidth = 32;  // of a panel
layout(constant_id = 5) const bool kWindowPanels = true;
layout(constant_id = 6) const bool kTurned = false;  // rows count the kernel from its last place

uint panelPlace(uint row, uint window) {
    return kWindowPanels ? panelIndex(window, row, params.rows, kWidth)
                         : panelIndex(row, window, params.images * params.windows, kWidth);
}

// Workgroups: x windows, y channels, z images.
ENTRY(gather) {
    uint window = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint channel = gl_WorkGroupID.y, n = gl_WorkGroupID.z;
    uint width = params.width, height = params.height;
    if (window >= params.windows) return;
    uint at = window + params.firstWindow;
    uint oy = quotient(at, params.byOutWidth), ox = remainder(at, oy, params.byOutWidth);
    // Negative positions wrap to large ones, so one comparison finds both sides.
    uint y = oy * kStride - params.padding, x = ox * kStride - params.padding;
    uint plane = params.startImage + (n * params.channels + channel) * height * width;
    uint place = n * params.windows + window;
    [[unroll]] for (uint ky = 0; ky < kKernelH; ++ky) {
        [[unroll]] for (uint kx = 0; kx < kKernelW; ++kx) {
            bool inside = y + ky < height && x + kx < width;
            float v = image.d[plane + (inside ? (y + ky) * width + x + kx : 0)];
            uint kernelPlace = ky * kKernelW + kx;
            if (kTurned) kernelPlace = kKernelH * kKernelW - 1 - kernelPlace;
            uint row = channel * kKernelH * kKernelW + kernelPlace;
            columns.d[panelPlace(row, place)] = inside ? v : 0;
        }
    }
}

// Likewise for kernels 4x4 of stride 2 and padding 1 over images of widths divisible by four, two
// windows per invocation: of each of four rows it sees pixels 2 ox - 1 to 2 ox + 4, the middle of
// three quads. A quad is inside the image or outside as a whole.
ENTRY(gather_strided) {
    uint window = 2 * (gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x);
    uint channel = gl_WorkGroupID.y, n = gl_WorkGroupID.z;
    uint width = params.width, height = params.height;
    if (window >= params.windows) return;
    uint at = window + params.firstWindow;
    uint oy = quotient(at, params.byOutWidth), ox = remainder(at, oy, params.byOutWidth);
    uint y = 2 * oy - 1, x = 2 * ox - 4;
    uint plane = params.startImage + (n * params.channels + channel) * height * width;
    uint place = n * params.windows + window;
    [[unroll]] for (uint ky = 0; ky < 4; ++ky) {
        float v[12];  // pixels x to x + 11; the windows start at x + 3 and x + 5
        [[unroll]] for (uint i = 0; i < 3; ++i) {
            bool inside = y + ky < height && x + 4 * i < width;
            vec4 four = imageQuads.d[(plane + (inside ? (y + ky) * width + x + 4 * i : 0)) / 4];
            [[unroll]] for (uint k = 0; k < 4; ++k) v[4 * i + k] = inside ? four[k] : 0;
        }
        uint row = channel * 16 + ky * 4;
        if (kWindowPanels) {
            [[unroll]] for (uint kx = 0; kx < 4; ++kx)
                pairs.d[panelPlace(row + kx, place) / 2] = vec2(v[kx + 3], v[kx + 5]);
        } else {
            [[unroll]] for (uint i = 0; i < 4; ++i) {  // window i / 2, kx = 2 (i % 2)
                uint first = 3 + 2 * (i / 2) + 2 * (i % 2);
                pairs.d[panelPlace(row + 2 * (i % 2), place + i / 2) / 2] =
                    vec2(v[first], v[first + 1]);
            }
        }
    }
}
