// The viewer's picture [H,W] from the nearest faces: painted, lit, over a background, packed to
// bytes; the mean of samples^2 samples per pixel. n is the interpolated normal in camera space:
//     a lamp           colour = paint (ambient + (1 - ambient) max(n . lamp, 0)), linear light
//     capture's light  colour = paint (1 + sum_k L_k Y_k(n)), sRGB-encoded, as texture/lit_texture
// Only stretches of pixels are shaded in which a face is seen (raster/seen_spans.comp), for a CPU's
// vectors would walk through the shading of the others too.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "raster/triangle.glsl"
#include "texture/light_basis.glsl"
#include "view/params.h"
// What it paints is fixed in the pipeline: a CPU's vectors would walk through every branch.
layout(constant_id = 1) const uint paint = kPaintTexture;
layout(constant_id = 2) const uint light = kLightFlat;
layout(constant_id = 3) const uint wireframe = 0;  // 1: the faces' edges on top
layout(constant_id = 4) const uint samples = 1;    // of the nearest faces, per pixel and axis
layout(constant_id = 5) const uint keys = 0;       // 1: of two numbers each, see nn/ops/raster.h
PARAMS(ShadeParams, 12)
BUFFER(0, readonly, uint, index);        // [H s,W s,1 + keys] NearestFaces::index
BUFFER(1, readonly, vec4, screen);       // [V] from raster/project.comp
BUFFER(2, readonly, float, normals);     // [V,3] the body's world, unit length
BUFFER(3, readonly, vec2, marks);        // [V] body part; clamp bound as part of the largest
BUFFER(4, readonly, ivec4, faces);       // [F] v0, v1, v2, unused
BUFFER(5, readonly, vec2, cornerUvs);    // [F,4] UVs of the corners; the last unused
BUFFER(6, readonly, uint, tex);          // [S,S] R, G, B, A from the lowest byte
BUFFER(7, readonly, float, visibility);  // [S,S]
BUFFER(8, readonly, ShadeState, state);  // [1]
BUFFER(9, readonly, uint, background);   // [H,W] as the picture, which starts as its copy
BUFFER(10, writeonly, uint, picture);    // [H,W]
BUFFER(11, readonly, uint, spans);       // [1+H W/kSpan] see SeenSpans in nn/ops/raster.h

// The face at a sample, -1: none.
int faceAt(uint at) { return int(keys == 0 ? index.d[at] : ~index.d[2 * at]); }

vec3 toLinear(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), greaterThan(c, vec3(0.04045)));
}
vec3 toSrgb(vec3 c) {
    return mix(12.92 * c, 1.055 * pow(c, vec3(1 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308)));
}

// Hues far apart from one part to the next.
vec3 partColour(float part) {
    vec3 hue = fract(part * 0.61803399 + vec3(0, 2, 1) / 3);
    return part < 0.5 ? vec3(0.5) : 0.25 + 0.7 * clamp(abs(hue * 6 - 3) - 1, 0, 1);
}

// Blue, white, red from 0 to 1.
vec3 heatColour(float t) {
    return t < 0.5 ? mix(vec3(0.15, 0.3, 0.75), vec3(0.95), 2 * t)
                   : mix(vec3(0.95), vec3(0.8, 0.15, 0.12), 2 * t - 1);
}

vec3 texel(ivec2 at) {
    uint t = uint(at.y) * params.textureSize + uint(at.x);
    if (paint == kPaintVisibility)
        return mix(vec3(0.25, 0.2, 0.3), vec3(0.55, 0.85, 0.5), visibility.d[t]);
    return unpackUnorm4x8(tex.d[t]).rgb;
}

// What the atlas holds at a UV: bilinear, clamped at the border.
vec3 paintAt(vec2 uv) {
    if (paint == kPaintChecker) {
        ivec2 cell = ivec2(floor(uv * 32));
        vec3 block = vec3(0.35, 0.35, 0.35) + 0.55 * vec3(uv, 0.5 * (2 - uv.x - uv.y));
        return ((cell.x + cell.y) & 1) == 0 ? block : 0.55 * block;
    }
    int last = int(params.textureSize) - 1;
    vec2 at = clamp(uv * float(params.textureSize) - 0.5, vec2(0), vec2(last));
    ivec2 low = ivec2(at), high = min(low + 1, last);
    vec2 share = at - vec2(low);
    return mix(mix(texel(low), texel(ivec2(high.x, low.y)), share.x),
               mix(texel(ivec2(low.x, high.y)), texel(high), share.x), share.y);
}

vec3 normalOf(int v) {
    return vec3(normals.d[3 * v], normals.d[3 * v + 1], normals.d[3 * v + 2]);
}

// How much of a pixel's colour is an edge's, at the point with barycentrics b. Faces of a few
// pixels keep most of their own colour, or a fine mesh would be nothing but edges.
float edgeShare(ivec3 v, vec3 b) {
    vec2 s0 = screen.d[v.x].xy / float(samples), s1 = screen.d[v.y].xy / float(samples);
    vec2 s2 = screen.d[v.z].xy / float(samples);
    float area = abs((s1.x - s0.x) * (s2.y - s0.y) - (s1.y - s0.y) * (s2.x - s0.x));
    vec3 lengths = vec3(distance(s1, s2), distance(s2, s0), distance(s0, s1));
    vec3 heights = area / max(lengths, 1e-6), distances = b * heights;
    float nearest = min(distances.x, min(distances.y, distances.z));
    float height = min(heights.x, min(heights.y, heights.z));
    return clamp(1 - nearest, 0, 1) * clamp((height - 0.5) / 5, 0.12, 0.75);
}

// Towards the eye is -z.
vec3 normalAt(ivec3 v, vec3 b) {
    ShadeState s = state.d[0];
    vec3 n = normalize(b.x * normalOf(v.x) + b.y * normalOf(v.y) + b.z * normalOf(v.z) +
                       vec3(0, 0, 1e-20));
    return vec3(dot(vec3(s.xx, s.xy, s.xz), n), dot(vec3(s.yx, s.yy, s.yz), n),
                dot(vec3(s.zx, s.zy, s.zz), n));
}

// What the capture's light makes of a colour.
vec3 lightFactor(vec3 n) {
    LightBasis at = lightBasis(n);
    vec3 factor = vec3(1);
    [[unroll]] for (uint k = 0; k < 8; ++k) {
        vec3 row = vec3(state.d[0].captureLight[3 * k], state.d[0].captureLight[3 * k + 1],
                        state.d[0].captureLight[3 * k + 2]);
        factor += at.y[k + 1] * row;
    }
    return factor;
}

// A face's at the sample in this column and row.
vec3 colourOf(uint face, uint column, uint row) {
    ivec3 v = faces.d[face].xyz;
    vec2 p = pixelCentre(int(column), int(row), params.width * samples, params.height * samples);
    vec3 b = surfaceAt(screen.d[v.x], screen.d[v.y], screen.d[v.z], p).xyz;
    vec3 n = vec3(0, 0, -1), colour;
    bool shaped = paint == kPaintClay || paint == kPaintNormals || paint == kPaintParts ||
                  paint == kPaintClamps;
    if (shaped || light != kLightFlat) n = normalAt(v, b);
    // Without a light of its own the shape is lit from the eye, so that it shows.
    float headlight = light == kLightLamp ? 1 : 0.4 + 0.6 * max(-n.z, 0);
    if (paint == kPaintClay) {
        colour = vec3(0.82, 0.8, 0.77) * headlight;
    } else if (paint == kPaintNormals) {
        colour = 0.5 + 0.5 * vec3(n.x, -n.y, -n.z);
    } else if (paint == kPaintParts || paint == kPaintClamps) {
        vec2 m0 = marks.d[v.x], m1 = marks.d[v.y], m2 = marks.d[v.z];
        float part = b.x >= max(b.y, b.z) ? m0.x : b.y >= b.z ? m1.x : m2.x;
        float bound = b.x * m0.y + b.y * m1.y + b.z * m2.y;
        colour = (paint == kPaintParts ? partColour(part) : heatColour(bound)) * headlight;
    } else {
        colour = paintAt(b.x * cornerUvs.d[4 * face] + b.y * cornerUvs.d[4 * face + 1] +
                         b.z * cornerUvs.d[4 * face + 2]);
    }
    if (light == kLightCapture) {
        colour = clamp(colour * lightFactor(n), 0, 1);
    } else if (light == kLightLamp && paint != kPaintNormals) {
        ShadeState s = state.d[0];
        float direct = max(dot(n, vec3(s.lampX, s.lampY, s.lampZ)), 0);
        colour = toSrgb(toLinear(clamp(colour, 0, 1)) * (s.ambient + (1 - s.ambient) * direct));
    }
    if (wireframe != 0) {
        float brightness = dot(colour, vec3(0.3, 0.6, 0.1));
        colour = mix(colour, brightness > 0.45 ? vec3(0.05) : vec3(0.9), edgeShare(v, b));
    }
    return colour;
}

// Over the listed spans, as many pixels at a time as there are invocations.
ENTRY(forward) {
    uint pixels = params.width * params.height, last = (pixels - 1) / kSpan;
    uint count = spans.d[0] * kSpan, step = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint k = linearIndex(); k < count; k += step) {
        // Clamped as well for lanes that are done: see faceInList().
        uint i = min(spans.d[1 + min(k / kSpan, last)] + k % kSpan, pixels - 1);
        uint y = quotient(i, params.byWidth), x = remainder(i, y, params.byWidth);
        vec3 behind = unpackUnorm4x8(background.d[i]).rgb, colour = vec3(0);
        for (uint n = 0; n < samples * samples; ++n) {
            uint row = y * samples + n / samples, column = x * samples + n % samples;
            int face = faceAt(row * params.width * samples + column);
            vec3 own = colourOf(uint(max(face, 0)), column, row);
            colour += face < 0 ? behind : own;
        }
        colour /= float(samples * samples);
        picture.d[i] = packUnorm4x8(vec4(colour, 1));
    }
}

// The atlas itself, in the lower right corner.
ENTRY(inset) {
    uint i = linearIndex(), side = params.inset;
    if (i >= side * side) return;
    uint x = i % side, y = i / side;
    vec3 colour = paintAt(vec2(x + 0.5, y + 0.5) / float(side));
    picture.d[(params.height - side + y) * params.width + params.width - side + x] =
        packUnorm4x8(vec4(colour, 1));
}
