// y[n, c] = the size x size pixels of x[n, c] around a centre (column and row in pixels, whose
// centres are at a half), 0 outside the picture: the faces that discriminator D1 sees. Windows
// start at a whole pixel, so that nothing is resampled; dx is dy put back.
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

// Workgroups: x columns and y rows of the window, z planes.
uvec2 pixel() {
    return uvec2(gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex(), gl_WorkGroupID.y);
}

// Where pixel at of the window lies in x or dx; false: outside.
bool findPixel(uvec2 at, out uint place) {
    uint plane = gl_WorkGroupID.z;
    ivec2 p = startOf(plane) + ivec2(at);
    place = (plane * params.height + uint(p.y)) * params.width + uint(p.x);
    return p.x >= 0 && p.y >= 0 && p.x < int(params.width) && p.y < int(params.height);
}
uint placeInWindow(uvec2 at) {
    return (gl_WorkGroupID.z * params.size + at.y) * params.size + at.x;
}

ENTRY(forward) {
    uvec2 at = pixel();
    if (at.x >= params.size) return;
    uint from;
    y.d[placeInWindow(at)] = findPixel(at, from) ? x.d[from] : 0;
}

// dx is zero before.
ENTRY(backward) {
    uvec2 at = pixel();
    uint to;
    if (at.x < params.size && findPixel(at, to)) dx.d[to] = dy.d[placeInWindow(at)];
}
