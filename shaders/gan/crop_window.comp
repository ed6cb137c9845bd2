#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "gan/params.h"
#include "gan/window.glsl"
PARAMS(CropWindowParams, 5)
BUFFER(0, readonly, float, x);        // [N,C,H,W]
BUFFER(1, readonly, float, centres);  // [N,2] column, row in pixels
BUFFER(2, writeonly, float, y);       // [N,C,size,size]
BUFFER(3, readonly, float, dy);       // [N,C,size,size]
BUFFER(4, writeonly, float, dx);      // [N,C,H,W]

ivec2 startOf(uint plane) {
    uint n = quotient(plane, params.byChannels);
    return ivec2(windowStart(centres.d[2 * n], params.size),
                 windowStart(centres.d[2 * n + 1], params.size));
}

// Workgroups: x columns, y rows, z planes.
uvec2 pixel() {
    return uvec2(gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex(), gl_WorkGroupID.y);
}

ENTRY(forward) {
    uint plane = gl_WorkGroupID.z;
    uvec2 at = pixel();
    if (at.x >= params.size) return;
    ivec2 p = startOf(plane) + ivec2(at);
    bool inside = p.x >= 0 && p.y >= 0 && p.x < int(params.width) && p.y < int(params.height);
    y.d[(plane * params.size + at.y) * params.size + at.x] = inside ? x.d[(plane * params.height + uint(p.y)) * params.width + uint(p.x)] : 0;
}

ENTRY(backward) {
    uint plane = gl_WorkGroupID.z;
    uvec2 at = pixel();
    if (at.x >= params.width) return;
    ivec2 p = ivec2(at) - startOf(plane);
    bool inside = p.x >= 0 && p.y >= 0 && p.x < int(params.size) && p.y < int(params.size);
    dx.d[(plane * params.height + at.y) * params.width + at.x] =
        inside ? dy.d[(plane * params.size + uint(p.y)) * params.size + uint(p.x)] : 0;
}
