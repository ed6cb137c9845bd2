// What a picture's gradient would have the surface do: force [H samples,W samples,2] = dL/dp, p the
// place in the picture, in samples, of the point of the surface that is seen at a sample.
//
// Inside a face, a surface that moves by dp brings the colour that was at -dp:
//     force = - sum over the channels of dS_c dS_c/dp,  dS_c/dp = (dtexture/duv) (duv/dp).
// Across a silhouette the derivative of a sample is zero almost everywhere, and what moves is the
// edge between two neighbouring samples, n near and f far: if their depths differ by more than
// edgeJump, the near surface carries the edge, and a motion of t samples towards the far one moves
// t (S_n - S_f) of the picture's sum, half of it through either sample:
//     force = 1/2 a sum over the channels and alpha of (dS_n + dS_f) (S_n - S_f),
// a the direction from n to f. No width of a rim is chosen, and so the loss is lowest where edges
// lie where they are (Li, Aittala, Durand, Lehtinen, Differentiable Monte Carlo Ray Tracing through
// Edge Sampling, ACM ToG 2018, is the idea; samples stand for edges here because faces are smaller
// than pixels).
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/divide.h"
#include "raster/params.h"
#include "raster/triangle.glsl"
layout(constant_id = 1) const uint samples = 1;
layout(constant_id = 2) const bool coloured = true;
PARAMS(SurfaceParams, 12)
BUFFER(0, readonly, int, index);        // [H samples,W samples]
BUFFER(1, readonly, vec4, surface);     // [H samples,W samples] barycentrics, depth
BUFFER(2, readonly, vec4, screen);      // [V] from project.comp
BUFFER(3, readonly, ivec4, faces);      // [F]
BUFFER(4, readonly, vec2, uvs);         // [T]
BUFFER(5, readonly, ivec4, facesUv);    // [F]
BUFFER(6, readonly, vec3, tex);         // [Ht,Wt,3]
BUFFER(7, readonly, vec3, colours);     // [H samples,W samples,3]
BUFFER(8, readonly, vec3, background);  // [H,W,3]
BUFFER(9, readonly, vec3, dImage);      // [H,W,3]
BUFFER(10, readonly, float, dAlpha);    // [H,W]
BUFFER(11, writeonly, vec2, force);     // [H samples,W samples,2]

uint pixelOf(int x, int y) { return uint(y) / samples * params.width + uint(x) / samples; }

// Colour and alpha at a sample.
vec4 shown(uint at, uint pixel) {
    bool covered = index.d[at] >= 0;
    if (!coloured) return vec4(0, 0, 0, covered ? 1 : 0);
    return covered ? vec4(colours.d[at], 1) : vec4(background.d[pixel], 0);
}

vec4 gradientAt(uint pixel) {
    return vec4(coloured ? dImage.d[pixel] : vec3(0), dAlpha.d[pixel]);
}

// Depth, far beyond everything where no face is seen.
float depthAt(uint at) { return index.d[at] < 0 ? 1e9 : surface.d[at].w; }

vec3 texel(uvec2 at) { return tex.d[at.y * params.textureWidth + at.x]; }

// dS_c/dx and dS_c/dy of the face's colour at p, per sample.
mat2x3 slopes(uint face, vec3 b, vec2 p) {
    ivec4 v = faces.d[face], t = facesUv.d[face];
    vec4 A = screen.d[v.x], B = screen.d[v.y], C = screen.d[v.z];
    // Each barycentric is w_i / sum w, with w the edge functions over the depths, linear in p.
    vec3 inverse = vec3(A.z, B.z, C.z);
    vec3 w = edgeFunctions(makeTriangle(A, B, C, 0), p) * inverse;
    vec3 dx = vec3(B.y - C.y, C.y - A.y, A.y - B.y) * inverse;
    vec3 dy = vec3(C.x - B.x, A.x - C.x, B.x - A.x) * inverse;
    float total = w.x + w.y + w.z;
    vec3 bx = (dx - b * (dx.x + dx.y + dx.z)) / total, by = (dy - b * (dy.x + dy.y + dy.z)) / total;
    mat3x2 corner = mat3x2(uvs.d[t.x], uvs.d[t.y], uvs.d[t.z]);
    // The bilinear texture's own slope, zero where it is clamped at the border.
    vec2 size = vec2(params.textureWidth, params.textureHeight);
    vec2 raw = (corner * b) * size - 0.5, at = clamp(raw, vec2(0), size - 1);
    vec2 low = floor(at), share = at - low;
    uvec2 first = uvec2(low), last = uvec2(min(low + 1, size - 1));
    vec3 t00 = texel(first), t10 = texel(uvec2(last.x, first.y));
    vec3 t01 = texel(uvec2(first.x, last.y)), t11 = texel(last);
    vec3 du = mix(t10 - t00, t11 - t01, share.y) * (raw.x == at.x ? size.x : 0);
    vec3 dv = mix(t01 - t00, t11 - t10, share.x) * (raw.y == at.y ? size.y : 0);
    vec2 uvx = corner * bx, uvy = corner * by;
    return mat2x3(du * uvx.x + dv * uvx.y, du * uvy.x + dv * uvy.y);
}

ENTRY(backward) {
    uint i = linearIndex(), columns = params.width * samples, rows = params.height * samples;
    if (i >= columns * rows) return;
    int face = index.d[i];
    vec2 sum = vec2(0);
    if (face >= 0) {
        int y = int(quotient(i, params.byWidth)), x = int(remainder(i, uint(y), params.byWidth));
        uint pixel = pixelOf(x, y);
        vec4 own = gradientAt(pixel), here = shown(i, pixel);
        vec4 seen = surface.d[i];
        if (coloured && own.xyz != vec3(0)) {
            mat2x3 slope = slopes(uint(face), seen.xyz, pixelCentre(x, y, columns, rows));
            sum -= own.xyz * slope;
        }
        for (int k = 0; k < 4; ++k) {
            ivec2 step = ivec2(k == 0 ? 1 : k == 1 ? -1 : 0, k == 2 ? 1 : k == 3 ? -1 : 0);
            int u = x + step.x, v = y + step.y;
            if (u < 0 || v < 0 || u >= int(columns) || v >= int(rows)) continue;
            uint at = uint(v) * columns + uint(u);
            if (!(depthAt(at) - seen.w > params.edgeJump)) continue;
            uint there = pixelOf(u, v);
            float pull = dot(own + gradientAt(there), here - shown(at, there));
            sum += 0.5 * pull * vec2(step);
        }
    }
    force.d[i] = sum * (1 / float(samples * samples));
}
