// One body of several in a picture [H,W]: where what was drawn before is nearer, that is seen.
//     depth = the least of the body's samples in the pixel,  nearest = min(depth, behind)
// Runs after view/shade.comp, which knows of no other body.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "raster/triangle.glsl"
#include "view/params.h"
layout(constant_id = 1) const uint samples = 1;  // of the nearest faces, per pixel and axis
layout(constant_id = 2) const uint keys = 0;     // 1: of two numbers each, see nn/ops/raster.h
PARAMS(LayerParams, 7)
BUFFER(0, readonly, uint, index);       // [H s,W s,1 + keys] NearestFaces::index
BUFFER(1, readonly, vec4, screen);      // [V] from raster/project.comp
BUFFER(2, readonly, ivec4, faces);      // [F] v0, v1, v2, unused
BUFFER(3, readonly, float, behind);     // [H,W] depths of what was drawn before, metres
BUFFER(4, readonly, uint, background);  // [H,W] that, as the picture
BUFFER(5, readwrite, uint, picture);    // [H,W]
BUFFER(6, writeonly, float, nearest);   // [H,W]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.width * params.height) return;
    uint y = quotient(i, params.byWidth), x = remainder(i, y, params.byWidth);
    float depth = behind.d[i];
    bool seen = false;
    for (uint n = 0; n < samples * samples; ++n) {
        uint row = y * samples + n / samples, column = x * samples + n % samples;
        uint at = row * params.width * samples + column;
        int face = int(keys == 0 ? index.d[at] : ~index.d[2 * at]);
        if (face < 0) continue;
        ivec3 v = faces.d[face].xyz;
        vec2 p = pixelCentre(int(column), int(row), params.width * samples,
                             params.height * samples);
        float own = surfaceAt(screen.d[v.x], screen.d[v.y], screen.d[v.z], p).w;
        if (own < depth) {
            depth = own;
            seen = true;
        }
    }
    if (!seen) picture.d[i] = background.d[i];
    nearest.d[i] = depth;
}
