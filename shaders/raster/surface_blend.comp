// A surface over a background, the mean of samples^2 samples per pixel:
//     image = 1 / samples^2 sum (the colour where a face is seen, else the background),
//     alpha = 1 / samples^2 sum (1 where a face is seen, else 0),
//     dcolour = teaches dimage / samples^2 where a face is seen.
// image [H,W,3] sRGB-encoded, alpha [H,W].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/divide.h"
#include "raster/params.h"
layout(constant_id = 1) const uint samples = 1;   // per pixel and axis
layout(constant_id = 2) const bool coloured = true;  // false: alpha alone
layout(constant_id = 3) const bool taught = false;   // there is teaches; else it is 1
PARAMS(SurfaceParams, 8)
BUFFER(0, readonly, int, index);         // [H samples,W samples] face, -1: none
BUFFER(1, readonly, vec3, colours);      // [H samples,W samples,3]
BUFFER(2, readonly, vec3, background);   // [H,W,3]
BUFFER(3, writeonly, vec3, image);       // [H,W,3]
BUFFER(4, writeonly, float, alpha);      // [H,W]
BUFFER(5, readonly, vec3, dImage);       // [H,W,3]
BUFFER(6, readonly, float, teaches);     // [H,W]
BUFFER(7, writeonly, vec3, dColours);    // [H samples,W samples,3]

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

ENTRY(backward) {
    uint i = linearIndex(), line = params.width * samples;
    if (i >= line * params.height * samples) return;
    uint y = quotient(i, params.byWidth), x = remainder(i, y, params.byWidth);
    uint pixel = y / samples * params.width + x / samples;
    float part = (taught ? teaches.d[pixel] : 1) / float(samples * samples);
    dColours.d[i] = index.d[i] < 0 ? vec3(0) : dImage.d[pixel] * part;
}
