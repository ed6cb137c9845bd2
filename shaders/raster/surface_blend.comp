// A surface over a background, the mean of samples^2 samples per pixel:
//     image = 1 / samples^2 sum (the colour where a face is seen, else the background),
//     alpha = 1 / samples^2 sum (1 where a face is seen, else 0),
//     dcolour = teaches cos^facing dimage / samples^2 where a face is seen,
// cos between the normal and the way to the camera: whoever sees a place askew sees it smaller and,
// where poses are off, elsewhere. Normals and powers are linear within a face; the normal is the
// face's own where none is given.
// image [H,W,3] sRGB-encoded, alpha [H,W].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/divide.h"
#include "raster/params.h"
layout(constant_id = 1) const uint samples = 1;   // per pixel and axis
layout(constant_id = 2) const bool coloured = true;  // false: alpha alone
layout(constant_id = 3) const bool taught = false;   // there is teaches; else it is 1
layout(constant_id = 4) const bool faced = false;    // there are powers; else they are 0
PARAMS(SurfaceParams, 12)
BUFFER(0, readonly, int, index);         // [H samples,W samples] face, -1: none
BUFFER(1, readonly, vec3, colours);      // [H samples,W samples,3]
BUFFER(2, readonly, vec3, background);   // [H,W,3]
BUFFER(3, writeonly, vec3, image);       // [H,W,3]
BUFFER(4, writeonly, float, alpha);      // [H,W]
BUFFER(5, readonly, vec3, dImage);       // [H,W,3]
BUFFER(6, readonly, float, teaches);     // [H,W]
BUFFER(7, writeonly, vec3, dColours);    // [H samples,W samples,3]
BUFFER(8, readonly, vec4, surface);      // [H samples,W samples] barycentrics, depth
BUFFER(9, readonly, ivec4, faces);       // [F]
BUFFER(10, readonly, vec3, verts);       // [V,3] m
BUFFER(11, readonly, vec4, facing);      // [V,4] normals, or zeros; powers

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.width * params.height) return;
    uint y = i / params.width, x = i - y * params.width, line = params.width * samples;
    vec3 sum = vec3(0), behind = coloured ? background.d[i] : vec3(0);
    float seen = 0;
    for (uint n = 0; n < samples * samples; ++n) {
        uint at = (y * samples + n / samples) * line + x * samples + n % samples;
        bool covered = index.d[at] >= 0;
        seen += covered ? 1 : 0;
        if (coloured) sum += covered ? colours.d[at] : behind;
    }
    float part = 1 / float(samples * samples);
    alpha.d[i] = seen * part;
    if (coloured) image.d[i] = sum * part;
}

// cos^facing where a sample sees the surface.
float facingAt(uint at) {
    ivec4 v = faces.d[index.d[at]];
    float b = surface.d[at].y, c = surface.d[at].z;
    vec4 there = (1 - b - c) * facing.d[v.x] + b * facing.d[v.y] + c * facing.d[v.z];
    float power = there.w;
    if (power <= 0) return 1;
    vec3 first = verts.d[v.x], ab = verts.d[v.y] - first, ac = verts.d[v.z] - first;
    vec3 p = first + b * ab + c * ac, normal = there.xyz;
    float towards = -dot(normal, p);
    if (normal == vec3(0)) {
        normal = cross(ab, ac);
        towards = abs(dot(normal, p));
    }
    float lengths = length(normal) * length(p);
    return lengths > 0 ? pow(clamp(towards / lengths, 0, 1), power) : 0;
}

ENTRY(backward) {
    uint i = linearIndex(), line = params.width * samples;
    if (i >= line * params.height * samples) return;
    uint y = quotient(i, params.byWidth), x = remainder(i, y, params.byWidth);
    uint pixel = y / samples * params.width + x / samples;
    float part = (taught ? teaches.d[pixel] : 1) / float(samples * samples);
    bool seen = index.d[i] >= 0;
    if (faced && seen) part *= facingAt(i);
    dColours.d[i] = seen ? dImage.d[pixel] * part : vec3(0);
}
