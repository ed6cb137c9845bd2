#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(ColumnsParams, 2)
BUFFER(0, readonly, float, image);     // [images, channels, height, width]
BUFFER(1, writeonly, float, columns);  // [images, channels * kKernelH * kKernelW, windows]

layout(constant_id = 1) const uint kKernelH = 4;
layout(constant_id = 2) const uint kKernelW = 4;
layout(constant_id = 3) const uint kStride = 2;

// Workgroups: x windows, y channels, z images.
ENTRY(gather) {
    uint window = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint channel = gl_WorkGroupID.y, n = gl_WorkGroupID.z;
    uint width = params.width, height = params.height, windows = params.windows;
    if (window >= windows) return;
    uint at = window + params.firstWindow;
    uint oy = quotient(at, params.byOutWidth), ox = remainder(at, oy, params.byOutWidth);
    // Negative positions wrap to large ones, so one comparison finds both sides.
    uint y = oy * kStride - params.padding, x = ox * kStride - params.padding;
    uint plane = params.startImage + n * params.strideImage + channel * height * width;
    uint target = (n * params.channels + channel) * (kKernelH * kKernelW) * windows + window;
    [[unroll]] for (uint ky = 0; ky < kKernelH; ++ky) {
        [[unroll]] for (uint kx = 0; kx < kKernelW; ++kx) {
            bool inside = y + ky < height && x + kx < width;
            float v = image.d[plane + (inside ? (y + ky) * width + x + kx : 0)];
            columns.d[target] = inside ? v : 0;
            target += windows;
        }
    }
}
