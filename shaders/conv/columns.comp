#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "conv/params.h"
#include "conv/columns.glsl"
PARAMS(ColumnsParams, 2)
BUFFER(0, readonly, float, image);     // [images, channels, height, width]
BUFFER(1, writeonly, float, columns);  // panels, see columns.glsl

layout(constant_id = 1) const uint kKernelH = 4;
layout(constant_id = 2) const uint kKernelW = 4;
layout(constant_id = 3) const uint kStride = 2;
layout(constant_id = 4) const uint kWidth = 32;
layout(constant_id = 5) const bool kWindowPanels = true;
layout(constant_id = 6) const bool kTurned = false;  // rows count the kernel from its last place

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
    Panels panels = Panels(params.channels * kKernelH * kKernelW, params.images * params.windows, kWidth,
                           kWindowPanels);
    [[unroll]] for (uint ky = 0; ky < kKernelH; ++ky) {
        [[unroll]] for (uint kx = 0; kx < kKernelW; ++kx) {
            bool inside = y + ky < height && x + kx < width;
            float v = image.d[plane + (inside ? (y + ky) * width + x + kx : 0)];
            uint kernelPlace = ky * kKernelW + kx;
            if (kTurned) kernelPlace = kKernelH * kKernelW - 1 - kernelPlace;
            uint row = channel * kKernelH * kKernelW + kernelPlace;
            columns.d[panelIndex(panels, row, place)] = inside ? v : 0;
        }
    }
}
