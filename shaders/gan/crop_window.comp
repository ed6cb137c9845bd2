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
    uint n = plane / params.channels;
    return ivec2(windowStart(centres.d[2 * n], params.size),
                 windowStart(centres.d[2 * n + 1], params.size));
}

ENTRY(forward) {
    uint i = linearIndex(), area = params.size * params.size;
    if (i >= params.planes * area) return;
    uint plane = i / area, at = i % area;
    ivec2 p = startOf(plane) + ivec2(at % params.size, at / params.size);
    bool inside = p.x >= 0 && p.y >= 0 && p.x < int(params.width) && p.y < int(params.height);
    y.d[i] = inside ? x.d[(plane * params.height + uint(p.y)) * params.width + uint(p.x)] : 0;
}

ENTRY(backward) {
    uint i = linearIndex(), area = params.width * params.height;
    if (i >= params.planes * area) return;
    uint plane = i / area, at = i % area;
    ivec2 p = ivec2(at % params.width, at / params.width) - startOf(plane);
    bool inside = p.x >= 0 && p.y >= 0 && p.x < int(params.size) && p.y < int(params.size);
    dx.d[i] = inside ? dy.d[(plane * params.size + uint(p.y)) * params.size + uint(p.x)] : 0;
}
