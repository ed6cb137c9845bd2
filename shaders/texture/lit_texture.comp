// A texture under a capture's light: each texel times a factor per channel that depends on which way
// the surface faces there, in spherical harmonics of up to the second degree, which hold all but a
// hundredth of what distant light does to a matt surface (Ramamoorthi, Hanrahan, An Efficient
// Representation for Irradiance Environment Maps, SIGGRAPH 2001):
//     lit = texture s(n),  s_c(n) = sum_k light_kc Y_k(n),  Y_0 = 1,
// the others scaled like it, so that the mean of Y_k^2 over all directions is 1. The n of a texel is
// the unit sum of the normals at its face's corners by their barycentrics, and a constant of the
// gradient; where it is zero, and between the charts, s is light_0. Colours are sRGB-encoded, and so
// are the factors: a power of a factor stays a factor.
// texture, lit [T,T,3], light [9,3], normals [V,3]. Sums over texels are taken in a fixed order.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "texture/light_basis.glsl"
#include "texture/params.h"
PARAMS(LitTextureParams, 11)
BUFFER(0, readonly, vec3, tex);          // [T,T,3]
BUFFER(1, readonly, vec3, light);        // [9,3]
BUFFER(2, readonly, vec3, normals);      // [V,3] unit, or zero
BUFFER(3, readonly, ivec4, faces);       // [F] v0, v1, v2, unused
BUFFER(4, readonly, int, texelFaces);    // [T,T] -1: between the charts
BUFFER(5, readonly, vec2, texelCorners); // [T,T,2] the second and third barycentrics
BUFFER(6, writeonly, vec3, lit);         // [T,T,3]; backward: of the texture's gradient
BUFFER(7, readonly, vec3, dLit);         // [T,T,3]
BUFFER(8, readwrite, vec3, partial);     // [9,partials,3]
BUFFER(9, writeonly, vec3, dLight);      // [9,3]
BUFFER(10, readwrite, vec3, factors);    // [T,T,3] s

LightBasis basisAt(uint texel) {
    vec3 n = vec3(0);
    int face = texelFaces.d[texel];
    if (face >= 0) {
        ivec4 v = faces.d[face];
        vec2 b = texelCorners.d[texel];
        n = (1 - b.x - b.y) * normals.d[v.x] + b.x * normals.d[v.y] + b.y * normals.d[v.z];
    }
    float size = length(n);
    return lightBasis(size > 1e-6 ? n / size : vec3(0));
}

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.texels) return;
    LightBasis at = basisAt(i);
    vec3 factor = vec3(0);
    [[unroll]] for (uint k = 0; k < 9; ++k) factor += at.y[k] * light.d[k];
    factors.d[i] = factor;
    lit.d[i] = tex.d[i] * factor;
}

ENTRY(backward_texture) {
    uint i = linearIndex();
    if (i < params.texels) lit.d[i] = dLit.d[i] * factors.d[i];
}

// One invocation over every texel whose number leaves its own when divided by their count.
ENTRY(backward_partial) {
    uint first = linearIndex();
    if (first >= params.partials) return;
    vec3 sums[9];
    [[unroll]] for (uint k = 0; k < 9; ++k) sums[k] = vec3(0);
    for (uint i = first; i < params.texels; i += params.partials) {
        vec3 d = dLit.d[i];
        if (d == vec3(0)) continue;
        d *= tex.d[i];
        LightBasis at = basisAt(i);
        [[unroll]] for (uint k = 0; k < 9; ++k) sums[k] += at.y[k] * d;
    }
    [[unroll]] for (uint k = 0; k < 9; ++k) partial.d[k * params.partials + first] = sums[k];
}

shared vec3 lanes[gl_WorkGroupSize.x];

// A workgroup per coefficient.
ENTRY(backward_light) {
    uint k = gl_WorkGroupID.x, lane = localIndex();
    vec3 sum = vec3(0);
    for (uint i = lane; i < params.partials; i += gl_WorkGroupSize.x)
        sum += partial.d[k * params.partials + i];
    lanes[lane] = sum;
    barrier();
    for (uint half_ = gl_WorkGroupSize.x / 2; half_ > 0; half_ /= 2) {
        if (lane < half_) lanes[lane] += lanes[lane + half_];
        barrier();
    }
    if (lane == 0) dLight.d[k] = lanes[0];
}
