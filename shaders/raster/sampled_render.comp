// image = a textured picture, the mean of samples^2 samples per pixel: of the nearest face at each,
// the texture at the perspective-correct UV, bilinear and clamped at the border. image [H,W,3],
// coverage [H,W]. Only spans in which a face is seen are shaded. No gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "raster/params.h"
#include "raster/triangle.glsl"
layout(constant_id = 1) const uint samples = 1;  // per pixel and axis
layout(constant_id = 2) const uint keys = 0;     // 1: of two numbers each
PARAMS(SampledRenderParams, 9)
BUFFER(0, readonly, uint, index);       // [H samples,W samples,1 + keys] NearestFaces::index
BUFFER(1, readonly, vec4, screen);      // [V] from project.comp
BUFFER(2, readonly, ivec4, faces);      // [F] v0, v1, v2, unused
BUFFER(3, readonly, vec2, uvs);         // [T]
BUFFER(4, readonly, ivec4, facesUv);    // [F] t0, t1, t2, unused
BUFFER(5, readonly, float, tex);        // [Ht,Wt,3]
BUFFER(6, readonly, uint, spans);       // [1+H W/kSpan] see SeenSpans in nn/ops/raster.h
BUFFER(7, writeonly, float, image);     // [H,W,3] zeros before
BUFFER(8, writeonly, float, coverage);  // [H,W] zeros before

vec3 texel(uint x, uint y) {
    uint t = 3 * (y * params.textureWidth + x);
    return vec3(tex.d[t], tex.d[t + 1], tex.d[t + 2]);
}

// What a face shows at the sample in this column and row: bilinear, clamped at the border.
vec3 colourOf(uint face, uint column, uint row) {
    ivec3 v = faces.d[face].xyz;
    ivec3 t = facesUv.d[face].xyz;
    vec2 p = pixelCentre(int(column), int(row), params.width * samples, params.height * samples);
    vec3 b = surfaceAt(screen.d[v.x], screen.d[v.y], screen.d[v.z], p).xyz;
    vec2 uv = b.x * uvs.d[t.x] + b.y * uvs.d[t.y] + b.z * uvs.d[t.z];
    vec2 size = vec2(params.textureWidth, params.textureHeight);
    vec2 at = clamp(uv * size - 0.5, vec2(0), size - 1);
    uvec2 low = uvec2(at), high = uvec2(min(floor(at) + 1, size - 1));
    vec2 share = at - floor(at);
    return mix(mix(texel(low.x, low.y), texel(high.x, low.y), share.x),
               mix(texel(low.x, high.y), texel(high.x, high.y), share.x), share.y);
}

// Over the listed spans, as many pixels at a time as there are invocations.
ENTRY(forward) {
    uint pixels = params.width * params.height, last = (pixels - 1) / kSpan;
    uint count = spans.d[0] * kSpan, step = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint k = linearIndex(); k < count; k += step) {
        // Clamped as well for lanes that are done: see faceInList().
        uint i = min(spans.d[1 + min(k / kSpan, last)] + k % kSpan, pixels - 1);
        uint y = quotient(i, params.byWidth), x = remainder(i, y, params.byWidth);
        vec3 colour = vec3(0);
        float seen = 0;
        for (uint n = 0; n < samples * samples; ++n) {
            uint row = y * samples + n / samples, column = x * samples + n % samples;
            uint at = row * params.width * samples + column;
            int face = int(keys == 0 ? index.d[at] : ~index.d[2 * at]);
            vec3 own = colourOf(uint(max(face, 0)), column, row);
            colour += face < 0 ? vec3(0) : own;
            seen += face < 0 ? 0 : 1;
        }
        colour /= float(samples * samples);
        image.d[3 * i] = colour.x;
        image.d[3 * i + 1] = colour.y;
        image.d[3 * i + 2] = colour.z;
        coverage.d[i] = seen / float(samples * samples);
    }
}
